"""--filter and --transform of `gmwm wv` and `gmwm fit`."""

import pytest

import gmwm as library
from gmwm.files.readers import read


@pytest.mark.slow
@pytest.mark.parametrize(("name", "transform"), [("la8", "modwt"), ("d4", "dwt"), ("haar", "dwt")])
def test_wv_is_the_library_s(gmwm, recording, name, transform):
    options = ("--axis", "gyro_y", "--filter", name, "--transform", transform)
    content = gmwm("wv", recording, *options, "--json").json
    wv = library.wavelet_variance(read(recording)["gyro_y"], filter=name, transform=transform)
    assert content["axes"]["gyro_y"] == wv.to_dict()
    assert f"{name} {transform}" in gmwm("wv", recording, *options).out


@pytest.mark.slow
def test_fit_is_the_library_s(gmwm, recording):
    content = gmwm("fit", recording, "--axis", "gyro_y", "--model", "WN + RW", "--filter", "d4", "--json").json
    fit = library.fit("WN + RW", library.wavelet_variance(read(recording)["gyro_y"], filter="d4"))
    assert content["axes"]["gyro_y"]["parameters"] == dict(fit.parameters)
    assert content["axes"]["gyro_y"]["wavelet_variance"]["filter"] == "d4"


def test_unknown_filter_is_one_line(gmwm, recording):
    gmwm("wv", recording, "--filter", "d5").require_refusal("d4")


@pytest.mark.slow
def test_moments_of_fit_are_the_library_s(gmwm, recording):
    options = ("--axis", "gyro_y", "--model", "WN + RW", "--moments", "haar + lags:2")
    content = gmwm("fit", recording, *options, "--json").json["axes"]["gyro_y"]
    fit = library.fit("WN + RW", read(recording)["gyro_y"], moments="haar + lags:2")
    assert content["parameters"] == dict(fit.parameters)
    assert content["wavelet_variance"]["levels"][:3] == [-2, -1, 1]
    assert content["weighting"] == "optimal"
    assert "and 2 lags" in gmwm("fit", recording, *options).out
