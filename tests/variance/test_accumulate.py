"""A record in chunks: how it is cut, merged or stored changes nothing; large scales take every τ/64-th place."""

import json
import pickle
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gmwm import Model, fit, wavelet_variance
from gmwm.base.errors import DataError, OptionError, ReadError
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.variance.accumulate import WaveletAccumulator
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.signals import Signal
from tests.helpers import codes, each, raises

RATE = 100.0
START = 12_345


def walk(samples, seed=1):
    """A static axis: an offset, white noise, and a walk."""
    rng = np.random.default_rng(seed)
    return 9.81 + 1e-3 * rng.normal(size=samples) + 1e-6 * np.cumsum(rng.normal(size=samples))


def part(x, start=START, exact=7, **options):
    made = WaveletAccumulator(RATE, exact=exact, start=start, **options)
    made.update(x)
    return made


def direct(x, level, start, stride):
    """The mean of W² over the coefficients that end before a multiple of the stride, as they are defined."""
    half = 1 << (level - 1)
    sums = np.concatenate([[0.0], np.cumsum(x - x.mean())])
    ends = np.arange(2 * half, x.size + 1)
    ends = ends[(ends + start) % stride == 0]
    w = (sums[ends] - 2 * sums[ends - half] + sums[ends - 2 * half]) / (2 * half)
    # A coefficient counts where its 64 blocks lie inside the record, as all of these do.
    return np.mean(w**2), w.size


def same(found, wanted):
    np.testing.assert_array_equal(found.counts, wanted.counts)
    np.testing.assert_allclose(found.variance, wanted.variance, rtol=1e-12)
    assert found.slope == pytest.approx(wanted.slope, rel=1e-9, abs=1e-15)
    assert (found.strides, found.samples) == (wanted.strides, wanted.samples)


@each("start", [0, 1, 63, START, 1 << 40])
@each("samples", [8, 100, 5_000, 70_001])
def test_each_level_is_what_it_says(samples, start):
    x = walk(samples)
    found, plain = part(x, start).result(), wavelet_variance(x, RATE)
    for level, variance, count, stride in zip(
        found.levels, found.variance, found.counts, found.strides or [1] * len(found), strict=True
    ):
        assert stride == max((1 << level) // 64, 1) if level > 7 else stride == 1
        wanted, places = direct(x, int(level), start, stride)
        assert count == places
        # The reference sums a walk's running sum in one piece.
        assert variance == pytest.approx(wanted, rel=1e-8)
    reach = min(7, len(plain))
    np.testing.assert_allclose(found.variance[:reach], plain.variance[:reach], rtol=1e-12)
    assert len(plain) - len(found) <= (1 if start else 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_cuts_and_merges_change_nothing(seed):
    rng = np.random.default_rng(seed)
    x = walk(int(rng.integers(20_000, 60_000)), seed)
    wanted = part(x).result()
    cuts = np.unique(np.concatenate([[0], rng.integers(1, x.size, size=rng.integers(1, 40)), [x.size]]))
    parts = [part(x[a:b], START + int(a)) for a, b in pairwise(cuts)]
    while len(parts) > 1:  # in any grouping
        k = int(rng.integers(len(parts) - 1))
        parts[k : k + 2] = [parts[k].merge(parts[k + 1])]
    same(parts[0].result(), wanted)
    gathered = WaveletAccumulator(RATE, exact=7, start=START)
    for a, b in pairwise(cuts):
        gathered.update(x[a:b])
        if rng.random() < 0.3 and len(gathered) >= 8:
            gathered.result()  # a look on the way
        if rng.random() < 0.3:
            gathered = pickle.loads(pickle.dumps(gathered))
    same(gathered.result(), wanted)


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 2, 3, 64, 1000])
def test_chunks_of_any_size_change_nothing(size):
    x = walk(1_000)
    wanted = part(x).result()
    live = WaveletAccumulator(RATE, exact=7, start=START)
    for k in range(0, x.size, size):
        live.update(x[k : k + size])
    same(live.result(), wanted)
    # One sample after the other, each worked on by itself.
    parts = [part(x[k : k + size], START + k) for k in range(0, x.size, size)]
    joint = parts[0]
    for following in parts[1:]:
        joint = joint.merge(following)
    same(joint.result(), wanted)


def test_a_state_goes_through_files(tmp_path):
    x = walk(50_000)
    live = part(x[:30_000], axis="gyro_x", unit="rad/s")
    np.savez(tmp_path / "state.npz", **live.to_dict())
    with np.load(tmp_path / "state.npz") as stored:
        restored = WaveletAccumulator.from_dict({name: stored[name] for name in stored})
    text = json.dumps({k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in live.to_dict().items()})
    for again in (restored, WaveletAccumulator.from_dict(json.loads(text))):
        again.update(x[30_000:])
        same(again.result(), part(x).result())
        assert (again.result().axis, again.result().unit) == ("gyro_x", "rad/s")
    assert len(WaveletAccumulator.from_dict(WaveletAccumulator(RATE).to_dict())) == 0
    with raises(ReadError, "'exact' is missing"):
        WaveletAccumulator.from_dict({"rate": 1.0, "levels": 3})
    with raises(ReadError, "accumulator"):
        WaveletAccumulator.from_dict({**live.to_dict(), "last_blocks": [[1.0]]})


@pytest.mark.parametrize("name", ["last_head", "last_tail", "last_squares", "last_heads", "last_tails"])
def test_an_array_of_another_dimension_is_refused(name):
    state = part(walk(5_000)).to_dict()
    with raises(ReadError, "lists of numbers"):
        WaveletAccumulator.from_dict({**state, name: [state[name]]})


@each("value", [1e308, -1e200, float("nan")])
@each("name", ["squares", "last_head", "last_tail", "last_squares", "last_heads", "last_tails"])
def test_a_sum_whose_square_overflows_is_refused(name, value):
    state = part(walk(5_000)).to_dict()
    with raises(ReadError):
        WaveletAccumulator.from_dict({**state, name: [value, *state[name][1:]]})


@pytest.mark.parametrize(("name", "value"), [("squares", -1.0), ("counts", -1), ("last_squares", -1.0)])
def test_a_negative_count_or_sum_of_squares_is_refused(name, value):
    state = part(walk(5_000)).to_dict()
    with raises(ReadError):
        WaveletAccumulator.from_dict({**state, name: [value, *state[name][1:]]})


def test_a_wrong_number_of_sums_is_refused():
    state = part(walk(5_000)).to_dict()
    with raises(ReadError, "sums of squares"):
        WaveletAccumulator.from_dict({**state, "last_squares": state["last_squares"][1:]})
    with raises(ReadError, "a row of blocks"):
        WaveletAccumulator.from_dict({**state, "last_blocks": []})


@each("value", [-1, 10**400, 1 << 62, 1e300])
@each("name", ["last_count", "last_start", "lengths", "filled", "every", "some_first"])
def test_a_number_of_samples_that_no_recording_has_is_refused(name, value):
    state = part(walk(5_000)).to_dict()
    with raises(ReadError, "number of samples"):
        WaveletAccumulator.from_dict({**state, name: [value] if name == "lengths" else value})


@pytest.mark.slow
def test_a_state_is_bounded():
    live = WaveletAccumulator(RATE, exact=8)
    rng = np.random.default_rng(1)
    live.update(rng.normal(size=1 << 19))
    live.result()
    before = len(pickle.dumps(live))
    for _ in range(8):
        live.update(rng.normal(size=1 << 19))
    live.result()
    assert len(pickle.dumps(live)) < 1.3 * before


def pieces(x, cuts):
    """A record with a gap at each cut."""
    ends = [0, *cuts, x.size]
    return Signal(x, RATE, segments=list(pairwise(ends)))


def test_gaps_begin_new_segments():
    x, cuts = walk(30_000), [5_000, 5_001, 5_050, 17_000]
    live = WaveletAccumulator(RATE, exact=14)
    for a, b in pairwise([0, *cuts, x.size]):
        live.update(x[a:b])
        live.gap()
        live.gap()
    found, wanted = live.result(), wavelet_variance(pieces(x, cuts))
    np.testing.assert_allclose(found.variance, wanted.variance, rtol=1e-12)
    np.testing.assert_array_equal(found.counts, wanted.counts)
    np.testing.assert_allclose(found.lower, wanted.lower, rtol=1e-12)
    assert found.segments == wanted.segments


@pytest.mark.parametrize("seed", range(6))
def test_parts_with_gaps_merge_anywhere(seed):
    rng = np.random.default_rng(seed)
    x = walk(20_000, seed)
    gaps = sorted(set(rng.integers(1, x.size, size=rng.integers(0, 6)).tolist()))
    cuts = sorted(set(rng.integers(1, x.size, size=rng.integers(1, 9)).tolist()))

    def fed(made, first, last):
        """The samples of a part, with the gaps inside it and at its end."""
        inside = [g for g in gaps if first < g <= last]
        for a, b in pairwise([first, *inside, last]):
            made.update(x[a:b])
            if b in inside:
                made.gap()
        return made

    wanted = fed(WaveletAccumulator(RATE, exact=7, start=START), 0, x.size).result()
    parts = [fed(WaveletAccumulator(RATE, exact=7, start=START + a), a, b) for a, b in pairwise([0, *cuts, x.size])]
    while len(parts) > 1:
        k = int(rng.integers(len(parts) - 1))
        parts[k : k + 2] = [pickle.loads(pickle.dumps(parts[k].merge(parts[k + 1])))]
    found = parts[0].result()
    same(found, wanted)
    assert found.segments == wanted.segments
    assert np.all(np.isfinite(np.diag(covariance(Model.parse("WN(sigma2=1.0)"), Design.of(found)))))


def test_samples_that_fit_into_memory_have_the_result_of_memory():
    x = walk(30_000)
    signal = Signal(x, RATE, segments=[(0, 12_000), (12_000, 30_000)])
    live = WaveletAccumulator(RATE, exact=15, robust=True)
    for k, part in enumerate(np.split(x, [1, 700, 12_000, 12_003, 25_000])):
        if k == 3:
            live.gap()
        live.update(part)
    assert live.result().to_dict() == wavelet_variance(signal).to_dict()
    assert live.result(robust=True).to_dict() == wavelet_variance(signal, robust=True).to_dict()
    assert live.result().remarks == ()


def test_samples_are_held_up_to_a_number():
    x = walk(20_000)
    held, summed = (WaveletAccumulator(RATE, exact=8, held=number) for number in (20_000, 19_999))
    for one in (held, summed):
        one.update(x[:15_000])
        one.update(x[15_000:])
    assert held.result().to_dict() == wavelet_variance(x, RATE).to_dict()
    same(summed.result(), part(x, 0, 8).result())
    assert summed.result().strides[-1] > 1


def test_strided_levels_are_named():
    found = part(walk(20_000), exact=10).result()
    assert codes(found.remarks) == ["approximated:levels"]
    assert "From a scale of 20.48 s on" in found.summary()


def test_levels_are_as_many_as_were_asked_for():
    x = walk(20_000)
    assert len(part(x, levels=5).result()) == 5
    assert len(part(x, levels=9).result()) == 9
    assert part(x, levels=5).result().strides == ()
    assert (
        WaveletVariance.from_dict(json.loads(json.dumps(part(x).result().to_dict()))).strides
        == part(x).result().strides
    )


def test_what_is_wrong_is_said():
    live = part(walk(100))
    with raises(DataError, count=1, index=1):
        live.update([1.0, np.nan])
    assert len(live) == 100
    live.update([])
    assert len(live) == 100
    with raises(DataError, 8, got=3):
        part(walk(3)).result()
    with raises(OptionError, "sample 12445", argument="start", got=START):
        live.merge(part(walk(10), START))
    with raises(OptionError, 7, argument="exact", got=8):
        live.merge(part(walk(10), START + 100, exact=8))
    with raises(OptionError, argument="following", expected="a WaveletAccumulator"):
        live.merge(walk(10))
    for name, value, fact in (
        ("rate", 0.0, "positive"),
        ("exact", 3, "a whole number from 6 to 24"),
        ("levels", 0, "a whole number from 1 to 44"),
        ("start", -1, "a whole number from 0"),
    ):
        with raises(OptionError, fact, argument=name, got=value):
            WaveletAccumulator(**({"rate": RATE} | {name: value}))


# --- robust -------------------------------------------------------------------------------------------


def contaminated(samples=60_000):
    x = walk(samples, 4)
    rng = np.random.default_rng(5)
    x[rng.choice(samples, samples // 500, replace=False)] += rng.normal(0, 1.0, samples // 500)
    return x


UNUSUAL = {
    "list": lambda x: x.tolist(),
    "float32": lambda x: x.astype(np.float32),
    "big-endian": lambda x: x.astype(">f8"),
    "every second": lambda x: np.repeat(x, 2)[::2],
    "not aligned": lambda x: np.frombuffer(b"0" + x.tobytes(), dtype=np.uint8)[1:].view(np.float64),
    "read-only": lambda x: np.frombuffer(x.tobytes()),
    "masked array": np.ma.asarray,
    "empty between": lambda x: x,
}


@pytest.mark.parametrize("kind", UNUSUAL)
def test_chunks_of_any_type_are_added_after_sums_have_begun(kind):
    x = np.round(64 * walk(40_000)) / 64  # values that float32 holds
    live = part(x[:30_000])
    for k in range(30_000, x.size, 1_000):
        live.update(UNUSUAL[kind](x[k : k + 1_000]))
        live.update(np.empty(0))
    same(live.result(), part(x).result())


@pytest.mark.parametrize(
    "bad",
    [[1.0, np.nan], np.array([np.inf, 1.0]), np.ma.array([1.0, 2.0], mask=[0, 1]), np.ones((2, 2)), np.array(["a"])],
)
def test_bad_chunks_are_rejected_after_sums_have_begun(bad):
    x = walk(40_000)
    live = part(x[:30_000])
    with pytest.raises(DataError, match="chunk"):
        live.update(bad)
    live.update(x[30_000:])
    same(live.result(), part(x).result())


@pytest.mark.parametrize("efficiency", [0.6, 0.9])
def test_a_robust_result_is_that_of_all_coefficients(efficiency):
    x = contaminated()
    live = part(x, 0, exact=14, robust=True)
    found = live.result(robust=True, efficiency=efficiency)
    wanted = wavelet_variance(x, RATE, robust=True, efficiency=efficiency)
    assert found.diagnostics["robust"]["outcome"][:12] == wanted.diagnostics["robust"]["outcome"][:12]
    np.testing.assert_allclose(found.variance[:12], wanted.variance[:12], rtol=1e-4)
    assert (found.robust, found.efficiency, found.slope) == (True, efficiency, None)
    # The classical result is another answer of the same state.
    np.testing.assert_allclose(live.result().variance[:14], wavelet_variance(x, RATE).variance[:14], rtol=1e-12)
    assert live.result().variance[0] > 2 * found.variance[0]


def test_robust_parts_merge_to_the_same():
    x = contaminated(30_000)
    whole = part(x[:20_000], robust=True)
    whole.gap()
    whole.update(x[20_000:])
    left, right = part(x[:7_001], robust=True), part(x[7_001:20_000], START + 7_001, robust=True)
    right.gap()
    right.update(x[20_000:])
    joint = pickle.loads(pickle.dumps(left)).merge(pickle.loads(pickle.dumps(right)))
    np.testing.assert_allclose(joint.result(robust=True).variance, whole.result(robust=True).variance, rtol=1e-9)
    same(joint.result(), whole.result())
    assert np.all(np.diag(covariance(Model.parse("WN(sigma2=1.0)"), Design.of(joint.result(robust=True)))) > 0)


def test_robust_results_must_be_planned_for():
    with raises(OptionError, argument="robust", advises=("robust=True",)):
        part(walk(100)).result(robust=True)
    with raises(OptionError, argument="robust"):
        part(walk(100)).merge(part(walk(100), START + 100, robust=True))
    with raises(OptionError, argument="efficiency"):
        part(walk(100), robust=True).result(efficiency=0.8)


# --- the covariance of what is taken -------------------------------------------------------------------

MODELS = (
    "WN(sigma2=1.0)",
    "WN(sigma2=1.0) + RW(gamma2=0.001)",
    "GM(beta=2.0, sigma2=1.0) + WN(sigma2=0.5)",
    "AR1(phi=-0.9, sigma2=1.0)",
    "QN(q2=1.0) + RW(gamma2=0.001)",
)


def brute_force(model, found, samples):
    """V from the covariance of all coefficients that are taken."""
    lags = np.arange(samples)
    distance = np.abs(np.subtract.outer(lags, lags))
    gamma = sum(p.generalised_covariance(lags, RATE)[distance] for p in model.processes)

    def coefficients(x, level, stride):
        """The coefficients of the columns of x that end at each place that is taken."""
        half, past = 1 << (level - 1), np.arange(1, samples + 1)
        past = past[(past >= 2 * half) & (past % stride == 0)]
        path = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)])
        return (path[past] - 2 * path[past - half] + path[past - 2 * half]) / (2 * half)

    taken = list(zip(found.levels, found.strides, strict=True))
    applied = [coefficients(gamma, *one).T for one in taken]
    return np.array([[2 * np.mean(coefficients(a, *one) ** 2) for one in taken] for a in applied])


@pytest.mark.slow
@pytest.mark.parametrize("text", MODELS[1::2] + MODELS[-1:])
def test_the_covariance_is_that_of_the_coefficients_taken(text):
    model, samples = Model.parse(text), 1 << 10
    found = part(model.simulate(samples, RATE, rng=1), 0, exact=6).result()
    assert found.strides == (1,) * 6 + (2, 4, 8, 16)
    v = covariance(model, Design.of(found))
    wanted = brute_force(model, found, samples)
    if model.terms[0] == "QN":
        # The brute force knows second moments alone: the rounding errors are uniform, which the first levels feel.
        keep = slice(8, None)
        v, wanted = v[keep, keep], wanted[keep, keep]
    size = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(np.diag(v), np.diag(wanted), rtol=2e-6)
    # Of two levels the coarser takes some of the places of the finer: but for the ends of the record.
    np.testing.assert_allclose(v / np.outer(size, size), wanted / np.outer(size, size), atol=0.03)


def test_the_cost_of_strides_is_that_of_theory():
    design = Design.of(part(walk(1 << 16), 0, exact=6).result())
    for text, largest in (("WN(sigma2=1.0)", 1.002), ("RW(gamma2=1.0)", 1.0005), ("GM(beta=1.0, sigma2=1.0)", 1.0005)):
        model = Model.parse(text)
        ratio = np.diag(covariance(model, design)) / np.diag(covariance(model, replace(design, strides=())))
        assert np.all(ratio[:12] < largest)
    quantized = Model.parse("QN(q2=1.0)")
    ratio = np.diag(covariance(quantized, design)) / np.diag(covariance(quantized, replace(design, strides=())))
    np.testing.assert_allclose(ratio[6:10], [2.0, 4.0, 8.0, 16.0], rtol=0.01)


def test_a_fit_to_an_accumulated_curve_is_that_of_the_record():
    model = Model.parse("WN(sigma2=1.0) + RW(gamma2=0.0001)")
    x = model.simulate(100_000, RATE, rng=3)
    whole, live = fit("WN + RW", x, RATE), fit("WN + RW", part(x, 0).result())
    for name, error in whole.standard_errors.items():
        assert abs(live.parameters[name] - whole.parameters[name]) < 0.1 * error
        assert live.standard_errors[name] == pytest.approx(error, rel=0.05)
