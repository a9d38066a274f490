"""The JSON Schema of calibration.json accepts what is written, and refuses what cannot be read."""

import copy
import json

import jsonschema
import pytest

import gmwm

VALIDATOR = jsonschema.Draft202012Validator(gmwm.Calibration.schema())


@pytest.fixture(scope="module")
def document():
    truth = {"gyro": "WN(sigma2=4e-7) + RW(gamma2=1e-11)", "accel": "WN(sigma2=1e-4)"}
    imu = gmwm.simulate(truth, rate=100.0, samples=20_000, rng=1)
    return json.loads(json.dumps(gmwm.calibrate(imu, within="GM + WN + RW").to_dict()))


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(gmwm.Calibration.schema())


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
def test_what_is_written_is_valid(document):
    assert [error.json_path for error in VALIDATOR.iter_errors(document)] == []
    several = gmwm.calibrate(
        [gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=8000, rng=k) for k in range(3)], within="WN"
    )
    assert [error.json_path for error in VALIDATOR.iter_errors(several.to_dict())] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("version",), 3),
        (("axes",), {}),
        (("axes", "gyro_x", "fit"), None),
        (("axes", "gyro_x", "fit", "wavelet_variance", "variance"), "x"),
        (("axes", "gyro_x", "fit", "wavelet_variance", "rate"), "100"),
        (("axes", "gyro_x", "goodness_of_fit", "pvalue"), "small"),
        (("axes", "gyro_x", "confidence_intervals"), {"WN.sigma2": "wide"}),
        (("remarks",), [{"code": "warm-up"}]),
        (("recording", "samples"), 1.5),
    ],
)
def test_a_wrong_value_is_refused(document, path, value):
    changed = copy.deepcopy(document)
    place = changed
    for key in path[:-1]:
        place = place[key]
    assert path[-1] in place
    place[path[-1]] = value
    assert not VALIDATOR.is_valid(changed)
