"""Hidden processes against conditional means and variances from whole covariance matrices, and a smoother in NumPy."""

from types import SimpleNamespace

import numpy as np
import pytest

from gmwm import Model, fit, fit_ml
from gmwm.base.errors import ModelError, OptionError
from gmwm.fitting.likelihood.system import assemble
from gmwm.recording.signals import Signal
from tests.helpers import each, raises
from tests.oracles import gaussian as oracle

RATE = 100.0
SAMPLES = 60
# A model, and the terms whose sum is the bias: all that stay over more than a sample, but no line. A drift is held.
MODELS = {
    "GM(beta=3.0, sigma2=2.0) + WN(sigma2=1.0)": ["GM"],
    "GM(beta=3.0, sigma2=2.0) + WN(sigma2=1.0) + RW(gamma2=0.05)": ["GM", "RW"],
    "RW(gamma2=0.05) + WN(sigma2=1.0)": ["RW"],
    "RW(gamma2=0.05) + QN(q2=1.0) + WN(sigma2=0.1)": ["RW"],
    "GM(beta=0.5, sigma2=2.0) + GM(beta=20.0, sigma2=0.5) + WN(sigma2=1.0)": ["GM[1]", "GM[2]"],
    "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0) + WN(sigma2=3.0)": ["AR(2)"],
    "GM(beta=3.0, sigma2=2.0)": ["GM"],
    "GM(beta=3.0, sigma2=2.0) + WN(sigma2=1.0) + DR(omega=fixed(0.2))": ["GM", "DR"],
    "SIN(frequency=7.0, power=3.0) + WN(sigma2=1.0)": [],
    "GM(beta=180.0, sigma2=2.0) + WN(sigma2=1.0) + GM(beta=3.0, sigma2=2.0)": ["GM[2]"],
}
MISSING = {
    "none": [],
    "scattered": [3, 17, 18, 40],
    "leading": list(range(7)),
    "trailing": list(range(50, 60)),
    "long": list(range(10, 45)),
}


def drawn(text, missing, seed=1):
    model = Model.parse(text)
    x = 9.81 + model.simulate(SAMPLES, RATE, rng=seed)
    x[missing] = np.nan
    return model, x


@pytest.mark.slow
@each(("mean", "missing"), [*((None, missing) for missing in MISSING.values()), (9.5, [*MISSING.values()][-1])])
@each("kind", ["filter", "smooth"])
@each("text", MODELS)
def test_tracks_are_conditional_means_and_deviations(text, kind, mean, missing):
    model, x = drawn(text, missing)
    tracks = model.smooth(x, RATE, mean=mean) if kind == "smooth" else model.kalman_filter(x, RATE, mean=mean)
    assert tracks.kind == kind
    np.testing.assert_array_equal(tracks.data, x)
    np.testing.assert_allclose(tracks.times, np.arange(SAMPLES) / RATE, rtol=1e-12)
    walk, ramp = "RW" in text, 0.2 * np.arange(SAMPLES) if "DR" in text else 0.0
    constant = mean or 0.0
    for label, wanted in [*((t, [t]) for t in model.terms), ("bias", MODELS[text]), ("level", [])]:
        if label == "level" and walk:
            assert label not in tracks.labels
            continue
        places = [model.terms.index(t) for t in wanted]
        # The unknown level belongs to the walk where there is one, and to the record otherwise.
        level = label in ("level", "bias") or label == "RW"
        expected, error = oracle.conditional(
            model, x, RATE, places, mean=mean, level=level, upto="now" if kind == "filter" else None
        )
        if level:
            expected = expected + constant
        if "DR" in wanted:
            expected = expected + ramp
        certain = np.isfinite(error)
        np.testing.assert_array_equal(np.isfinite(tracks.error[label]), certain, err_msg=label)
        np.testing.assert_allclose(tracks.mean[label][certain], expected[certain], rtol=1e-9, atol=1e-8, err_msg=label)
        # Of a variance that is next to nothing beside what it is a difference of, rounding is left.
        np.testing.assert_allclose(
            tracks.error[label][certain] ** 2, error[certain] ** 2, rtol=1e-8, atol=1e-12, err_msg=label
        )


@each("mean", [None, 9.5])
@each("text", MODELS)
def test_a_prediction_is_what_the_record_says_of_missing_samples(text, mean):
    model, x = drawn(text, [3, 59])
    steps = 25
    ahead = model.predict(x, steps, RATE, mean=mean)
    longer = np.r_[x, np.full(steps, np.nan)]
    assert len(ahead) == steps
    np.testing.assert_allclose(ahead.times, (SAMPLES + np.arange(steps)) / RATE, rtol=1e-12)
    assert np.all(np.isnan(ahead.data))
    for other in (model.smooth(longer, RATE, mean=mean), model.kalman_filter(longer, RATE, mean=mean)):
        assert other.labels == ahead.labels
        for label in ahead.labels:
            np.testing.assert_allclose(ahead.mean[label], other.mean[label][-steps:], rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(ahead.error[label], other.error[label][-steps:], rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("text", [t for t in MODELS if "DR" not in t])
def test_all_parts_add_up_to_the_record(text):
    model, x = drawn(text, [])
    for tracks in (model.smooth(x, RATE), model.kalman_filter(x, RATE)):
        total = sum(tracks.mean[label] for label in tracks.labels if label != "bias")
        known = np.isfinite(tracks.error["bias"])
        np.testing.assert_allclose(total[known], x[known], rtol=1e-10)


def reference(system, series):
    """Means (n, p) and covariances (n, p, p) of a smoother of Rauch, Tung and Striebel, one row after the other."""
    F, Q, H, R, P = system.matrices
    n, p = series.shape[1], H.size
    a = np.zeros((len(series), p))
    before, after, covariances, spreads = [], [], [], []
    for t in range(n):
        before.append(a)
        covariances.append(P)
        M, S = P @ H, H @ P @ H + R
        if np.isfinite(series[0, t]):
            a, P = a + np.outer(series[:, t] - a @ H, M / S), P - np.outer(M, M) / S
        after.append(a)
        spreads.append(P)
        a, P = a @ F.T, F @ P @ F.T + Q
    for t in range(n - 2, -1, -1):
        gain = np.linalg.solve(covariances[t + 1], F @ spreads[t]).T
        after[t] = after[t] + (after[t + 1] - before[t + 1]) @ gain.T
        spreads[t] = spreads[t] + gain @ (spreads[t + 1] - covariances[t + 1]) @ gain.T
    return np.array(after), np.array(spreads)


@pytest.mark.slow
@pytest.mark.parametrize("gaps", [False, True])
def test_a_record_of_many_blocks_is_smoothed_as_one(gaps):
    model = Model.parse("GM(beta=2.0, sigma2=2.0) + WN(sigma2=1.0) + GM(beta=20.0, sigma2=0.5)")
    n = 2 * 4096 + 777
    x = model.simulate(n, RATE, rng=3)
    if gaps:
        x[[0, *range(4090, 4100), 8191, 8192, *range(5000, 8900, 31), n - 1]] = np.nan
    tracks = model.smooth(x, RATE, mean=0.0)
    system = assemble(model, RATE)
    means, spreads = reference(system, x[None, :])
    for k, label in enumerate(p.label for p in system.blocks if p.space.states):
        np.testing.assert_allclose(tracks.mean[label], means[:, 0, k], rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(tracks.error[label], np.sqrt(spreads[:, k, k]), rtol=1e-8)
    there = np.isfinite(x)
    rest = x - tracks.mean["bias"]
    np.testing.assert_allclose(tracks.mean["WN"][there], rest[there], rtol=1e-8, atol=1e-9)
    assert np.all(tracks.mean["WN"][~there] == 0)
    np.testing.assert_allclose(tracks.error["WN"][~there], 1.0, rtol=1e-12)
    np.testing.assert_allclose(tracks.error["WN"][there], tracks.error["bias"][there], rtol=1e-8)


@pytest.mark.slow
def test_an_unknown_level_is_smoothed_over_many_blocks_too():
    model = Model.parse("WN(sigma2=1.0) + RW(gamma2=0.01)")
    n = 2 * 4096 + 5
    x = 9.81 + model.simulate(n, RATE, rng=4)
    x[[*range(10), *range(4000, 4300)]] = np.nan
    tracks = model.smooth(x, RATE)
    # A walk without a start: as from one of a variance that no sample can tell from an endless one.
    system = assemble(model, RATE)
    wide = SimpleNamespace(matrices=(system.F, system.Q, system.H, system.R, np.array([[1e7]])))
    means, spreads = reference(wide, (x - 9.81)[None, :])
    np.testing.assert_allclose(tracks.mean["RW"], 9.81 + means[:, 0, 0], rtol=1e-6)
    np.testing.assert_allclose(tracks.error["RW"], np.sqrt(spreads[:, 0, 0]), rtol=1e-6)


def test_nothing_is_known_before_the_first_sample():
    model, x = drawn("RW(gamma2=0.05) + WN(sigma2=1.0)", list(range(7)))
    tracks = model.kalman_filter(x, RATE)
    assert np.all(np.isinf(tracks.error["RW"][:7]))
    assert np.all(np.isnan(tracks.mean["bias"][:7]))
    assert np.all(np.isfinite(tracks.error["RW"][7:]))
    assert tracks.error["RW"][7] == pytest.approx(1.0, rel=1e-12)
    low, high = tracks.band("RW")
    assert np.all(np.isneginf(low[:7]))
    assert np.all(np.isposinf(high[:7]))
    assert np.all(np.isfinite(model.smooth(x, RATE).error["RW"]))


def test_bands_are_normal_intervals():
    model, x = drawn("GM(beta=3.0, sigma2=2.0) + WN(sigma2=1.0)", [])
    tracks = model.smooth(x, RATE)
    low, high = tracks.band(level=0.6826894921370859)
    np.testing.assert_allclose(high - tracks.mean["bias"], tracks.error["bias"], rtol=1e-10)
    np.testing.assert_allclose(low + high, 2 * tracks.mean["bias"], rtol=1e-10)
    with raises(OptionError, "GM, WN, level, bias", argument="label", got="RW"):
        tracks.band("RW")
    with raises(OptionError, "level", 0.5, 95):
        tracks.band(level=95)
    with pytest.raises(ValueError, match="read-only"):
        tracks.mean["bias"][0] = 0


def test_bands_hold_the_truth_as_often_as_they_say():
    slow, white = Model.parse("GM(beta=2.0, sigma2=2.0)"), Model.parse("WN(sigma2=1.0)")
    model = Model.parse("GM(beta=2.0, sigma2=2.0) + WN(sigma2=1.0)")
    inside = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        truth = 1.0 + slow.simulate(300, RATE, rng)
        tracks = model.smooth(truth + white.simulate(300, RATE, rng), RATE)
        low, high = tracks.band()
        inside.append((low <= truth) & (truth <= high))
    shares = np.mean(inside, axis=1)
    assert abs(shares.mean() - 0.95) < 4 * shares.std() / np.sqrt(len(shares))


def test_a_fit_carries_its_rate_and_its_mean():
    model = Model.parse("GM(beta=3.0, sigma2=2.0) + WN(sigma2=1.0)")
    x = model.simulate(3000, RATE, rng=5)
    found = fit_ml("GM + WN", x, RATE, mean=0.0)
    tracks = found.smooth(x)
    assert tracks.labels == ("GM", "WN", "bias")
    np.testing.assert_allclose(tracks.mean["bias"], found.model.smooth(x, RATE, mean=0.0).mean["bias"], rtol=1e-12)
    assert "level" in fit("GM + WN", x, RATE).smooth(x).labels
    signal = Signal(x, RATE, unit="rad/s", axis="gyro_x")
    assert (found.kalman_filter(signal).unit, found.kalman_filter(signal).axis) == ("rad/s", "gyro_x")
    with raises(OptionError, 100, argument="rate", got=200.0):
        found.smooth(x, 200.0)
    with raises(OptionError, 100, argument="rate", got=200.0):
        found.smooth(Signal(x, 200.0))
    with raises(OptionError, "at least 1", argument="steps", got=0):
        found.predict(x, 0)
    with raises(ModelError, "GM.beta, GM.sigma2, WN.sigma2"):
        Model.parse("GM + WN").smooth(x, RATE)
    with raises(ModelError, "SIN(frequency=", "exactly", advises=["white noise"]):
        Model.parse("SIN(frequency=7.0, power=1.0)").smooth(x, RATE)


def test_gaps_of_a_signal_are_missing_samples():
    model = Model.parse("GM(beta=3.0, sigma2=2.0) + WN(sigma2=1.0)")
    x = model.simulate(400, RATE, rng=6)
    whole = x.copy()
    whole[150:230] = np.nan
    pieces = Signal(np.r_[x[:150], x[230:]], RATE, segments=[(0, 150), (150, 320)], starts=[5.0, 7.3])
    expected, got = model.smooth(whole, RATE), model.smooth(pieces)
    np.testing.assert_array_equal(np.isnan(got.data), np.isnan(whole))
    np.testing.assert_allclose(got.mean["bias"], expected.mean["bias"], rtol=1e-12)
    np.testing.assert_allclose(got.error["bias"], expected.error["bias"], rtol=1e-12)
    np.testing.assert_allclose(got.times[[0, 230]], [5.0, 7.3], rtol=1e-12)


def test_a_walk_that_is_zero_leaves_the_level_to_the_record():
    x = 9.81 + Model.parse("WN(sigma2=1.0)").simulate(500, RATE, rng=1)
    tracks = Model.parse("WN(sigma2=1.0) + RW(gamma2=0.0)").smooth(x, RATE)
    np.testing.assert_allclose(tracks.mean["level"], x.mean(), rtol=1e-12)
    np.testing.assert_array_equal(tracks.mean["RW"], 0.0)


def test_predictions_have_an_end():
    with raises(OptionError, 10_000_000, argument="steps", got=10**11):
        Model.parse("WN(sigma2=1.0)").predict(np.arange(20.0), 10**11, RATE)
