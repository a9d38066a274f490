"""Units whose curves are those of their models to the last digit: no draws, so that files can be compared."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm.base.template import fact_text
from gmwm.choosing.datasheets.effective import DEFAULT_HORIZON_S
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.showing.exporters.base import _options, find_exporter
from gmwm.showing.exporters.text import plain
from gmwm.theory.processes import Model

RATE, SAMPLES = 200.0, 400_000
UNITS = {"gyro": "rad/s", "accel": "m/s²"}
WITHIN = "2*GM + WN + QN + RW"

# Axis by axis: a Gauss-Markov term on every axis, slow or fast; none with a walk; quantization noise on all.
TRUTHS = {
    "gauss-markov": {
        "gyro_x": "GM(beta=0.1, sigma2=2e-8) + WN(sigma2=6e-7)",
        "gyro_y": "GM(beta=20.0, sigma2=5e-8) + GM(beta=0.1, sigma2=1e-8) + WN(sigma2=4e-7)",
        "gyro_z": "GM(beta=0.2, sigma2=3e-8) + WN(sigma2=5e-7)",
        "accel_x": "GM(beta=0.1, sigma2=2e-6) + WN(sigma2=2e-5)",
        "accel_y": "GM(beta=0.3, sigma2=1e-6) + WN(sigma2=3e-5)",
        "accel_z": "GM(beta=0.1, sigma2=3e-6) + WN(sigma2=4e-5)",
    },
    "no-walk": {
        "gyro_x": "WN(sigma2=6e-7)",
        "gyro_y": "WN(sigma2=4e-7)",
        "gyro_z": "GM(beta=20.0, sigma2=5e-8) + WN(sigma2=5e-7)",
        "accel_x": "WN(sigma2=2e-5)",
        "accel_y": "WN(sigma2=3e-5)",
        "accel_z": "WN(sigma2=4e-5)",
    },
    "quantized": {
        "gyro_x": "QN(q2=3e-7) + WN(sigma2=6e-7) + RW(gamma2=1e-11)",
        "gyro_y": "QN(q2=2e-7) + WN(sigma2=4e-7) + RW(gamma2=3e-11)",
        "gyro_z": "QN(q2=4e-7) + WN(sigma2=5e-7) + RW(gamma2=2e-11)",
        "accel_x": "QN(q2=1e-5) + WN(sigma2=2e-5) + RW(gamma2=2e-10)",
        "accel_y": "QN(q2=2e-5) + WN(sigma2=3e-5) + RW(gamma2=1e-10)",
        "accel_z": "QN(q2=3e-5) + WN(sigma2=4e-5) + RW(gamma2=3e-10)",
    },
}


def exact_curve(axis, truth):
    """The wavelet variance of a model, as if it had been measured."""
    like = wavelet_variance(np.random.default_rng(0).standard_normal(SAMPLES), RATE)
    ratio = Model.parse(truth).wavelet_variance(like.levels, RATE) / like.variance
    values = {name: getattr(like, name) * ratio for name in ("variance", "lower", "upper")}
    return replace(like, **values, axis=axis, unit=UNITS[axis.partition("_")[0]], slope=None)


def calibrated(truths, within=WITHIN):
    return replace(
        gmwm.calibrate({axis: exact_curve(axis, truth) for axis, truth in truths.items()}, within), source="bench.csv"
    )


def remarks_in(calibration, format, **options):
    """The remarks in a file."""
    exporter = find_exporter(format)
    given = {"axes": None, "inflation": 1.0, "horizon": DEFAULT_HORIZON_S, "rate": None, "duration": None} | options
    return exporter.remarks(calibration, _options(exporter, given))


def as_golden(calibration, format):
    """A file with each remark as its code, subjects and facts, so that a golden file does not depend on the wording."""

    def coded(group, dialect):
        facts = [f"{name}={fact_text(fact)}" for remark in group for name, fact in sorted(remark.facts.items())]
        return " ".join([f"[{group[0].code}]", *(remark.subject for remark in group), *facts])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gmwm.base.remarks.rendering._group_text", coded)
        return calibration.export(format=format)


def words(text):
    """Text on one line, as files write it, without the marks of comments."""
    text = head_of(text)
    return " ".join(plain(re.sub(r"^\s*(#|%|//|;)", " ", text, flags=re.MULTILINE)).split())


def head_of(text):
    """The file, with the head of a JSON file as lines of text."""
    content = json.loads(text) if text.startswith("{") else {}
    return (
        "\n".join([*content["gmwm"], *content.get("gmwm_notes", [])]) if isinstance(content.get("gmwm"), list) else text
    )


@pytest.fixture(scope="session")
def units():
    return {name: calibrated(truths) for name, truths in TRUTHS.items()}


@pytest.fixture(scope="session", params=list(TRUTHS))
def unit(request, units):
    """Its name and its calibration."""
    return request.param, units[request.param]
