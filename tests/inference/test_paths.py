import os
import signal
import sys
import threading
import time
import tracemalloc
from typing import ClassVar

import numpy as np
import pytest
from scipy.signal import lfilter

from gmwm import GM, RW, WN, Model, wavelet_variance
from gmwm.base.errors import MissingTheoryError, ModelError, OptionError
from gmwm.fitting.estimation.simulated_curves import DRAWN_SAMPLES, simulated_variances
from gmwm.measuring.covariance import wavelet_covariance
from gmwm.measuring.covariance.design import Design
from gmwm.theory.filters import find_filter
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.parameter import Parameter
from gmwm.theory.statespace import StateSpace
from tests.helpers import each, raises

SUM = "WN(sigma2=1.0) + GM(beta=0.5, sigma2=2.0) + RW(gamma2=0.01) + QN(q2=3.0) + DR(omega=0.001)"


def design(samples, levels=None, **options):
    options.setdefault("rate", 10.0)
    wanted = np.arange(1, samples.bit_length()) if levels is None else np.asarray(levels)
    return Design(wanted, samples, **options)


def standard_errors(rows, expected):
    """(mean − expected) / standard error of the mean, by level."""
    return (rows.mean(axis=0) - expected) / (rows.std(axis=0, ddof=1) / np.sqrt(len(rows)))


# --- which numbers -----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("samples", [100, 5000, DRAWN_SAMPLES + 3])
def test_neither_threads_nor_draws_matter(samples):
    model, where = Model.parse(SUM), design(samples)
    draws = max(3, 2 * DRAWN_SAMPLES // samples + 2)
    rows = simulated_variances(model, where, draws, seed=3, threads=1)
    assert rows.shape == (draws, where.levels.size)
    assert len(np.unique(rows[:, 0])) == draws
    for threads in (2, 5):
        assert np.array_equal(simulated_variances(model, where, draws, seed=3, threads=threads), rows)
    for fewer in (1, 2, draws - 1):
        assert np.array_equal(simulated_variances(model, where, fewer, seed=3), rows[:fewer])
    assert not np.any(simulated_variances(model, where, 2, seed=4) == rows[:2])


def test_rows_are_the_wavelet_variances_of_the_paths():
    class Told(Process, register=False):
        """A ramp that bends: known paths, whichever the generator."""

        name, title = "TOLD", "Told"
        parameters = (Parameter("q2", "q²", "scale", signal_power=2, scale_power=1),)
        stationary: ClassVar[bool] = False

        def __init__(self):
            object.__setattr__(self, "q2", 1.0)

        @classmethod
        def shape(cls, nonlinear, levels, rate, filter=None):
            raise AssertionError("no theory is needed")

        def simulate(self, n, rate, rng, paths=None):
            return np.sqrt(np.arange(1.0, 1 + paths))[:, None] * np.sin(np.arange(n) ** 2 / 50.0)

    path = np.sin(np.arange(600) ** 2 / 50.0)
    for options in (
        {},
        {"filter": "la8"},
        {"transform": "dwt"},
        {"efficiency": 0.7},
        {"filter": "d4", "efficiency": 0.9},
    ):
        plain = {"robust": True, **options} if "efficiency" in options else options
        wv = wavelet_variance(path, 10.0, **plain)
        rows = simulated_variances(Model((Told(),)), Design.of(wv), 3, seed=0)
        for k, row in enumerate(rows):
            assert row == pytest.approx((k + 1) * wv.variance, rel=1e-9)


def test_some_levels_are_those_of_all():
    model = Model.parse(SUM)
    every = simulated_variances(model, design(300), 5, seed=1)
    assert np.array_equal(simulated_variances(model, design(300, [2, 5, 6]), 5, seed=1), every[:, [1, 4, 5]])


@pytest.mark.parametrize("power", [-40, 40])
def test_scales_with_the_model(power):
    model = Model.parse("WN(sigma2=1.0) + RW(gamma2=0.25) + QN(q2=4.0)")
    scaled = Model(tuple(p.with_values(**{p.scale_parameter().name: p.scale * 4.0**power}) for p in model.processes))
    one, other = (simulated_variances(m, design(512), 20, seed=1) for m in (model, scaled))
    assert other == pytest.approx(one * 4.0**power, rel=1e-9)


# --- their distribution ------------------------------------------------------------------------------


@pytest.mark.slow
@each("options", [{}, {"filter": find_filter("la8")}, {"transform": "dwt"}])
@each(
    "text",
    ["WN(sigma2=2.0)", "QN(q2=3.0)", "RW(gamma2=0.5)", "GM(beta=0.3, sigma2=2.0)", "AR1(phi=-0.7, sigma2=1.0)", SUM],
)
def test_mean_is_the_models_wavelet_variance(text, options):
    model = Model.parse(text)
    whole = design(512, levels=np.arange(1, 6), **options)
    rows = simulated_variances(model, whole, 1000, seed=7)
    expected = model.wavelet_variance(whole.levels, whole.rate, whole.filter)
    assert np.all(np.abs(standard_errors(rows, expected)) < 4)


def test_a_drift_alone_is_no_noise():
    model = Model.parse("DR(omega=-0.2)")
    rows = simulated_variances(model, design(1000), 3, seed=1)
    assert rows == pytest.approx(np.tile(model.wavelet_variance(9, 10.0), (3, 1)), rel=1e-9)


@pytest.mark.slow
def test_a_slow_process_is_stationary_from_the_start():
    n, draws, model = 1024, 4000, Model.parse("GM(beta=3.0, sigma2=1.0)")
    where = design(n, levels=[9, 10], rate=float(n))
    expected = model.wavelet_variance(where.levels, where.rate)
    assert np.all(np.abs(standard_errors(simulated_variances(model, where, draws, seed=2), expected)) < 4)
    # The same check sees a start at zero.
    phi = np.exp(-3.0 / n)
    noise = np.random.default_rng(1).standard_normal((draws, n))
    late = lfilter([np.sqrt(1 - phi**2)], [1.0, -phi], noise, axis=-1)
    rows = np.array([wavelet_variance(path, float(n)).variance[8:] for path in late])
    assert np.all(np.abs(standard_errors(rows, expected)) > 6)


@pytest.mark.slow
def test_spread_is_the_exact_covariance():
    model, draws = WN(sigma2=1.0) + GM(beta=0.2, sigma2=1.5), 4000
    rows = simulated_variances(model, design(1024, levels=np.arange(1, 9)), draws, seed=5)
    away = rows - rows.mean(axis=0)
    products = away[:, :, None] * away[:, None, :]
    error = products.std(axis=0) / np.sqrt(draws)
    exact = wavelet_covariance(model, 1024, 10.0, levels=8)
    assert np.all(np.abs(products.mean(axis=0) - exact) < 4 * error)


@pytest.mark.slow
def test_robust_estimates_are_those_of_the_model_too():
    model = WN(sigma2=1.0) + RW(gamma2=0.01)
    robust = design(4096, levels=[1, 2, 3, 4], efficiency=0.6)
    classical = design(4096, levels=[1, 2, 3, 4])
    a, b = (simulated_variances(model, s, 300, seed=1) for s in (robust, classical))
    assert np.all(np.abs(a.mean(axis=0) / model.wavelet_variance(4, 10.0) - 1) < 0.02)
    # Its price: between 1 and 1/efficiency.
    inflation = a.var(axis=0) / b.var(axis=0)
    assert np.all((inflation > 1.1) & (inflation < 1 / 0.6))


def test_a_process_known_by_its_state_space_alone():
    class Own(Process, register=False):
        """White noise by its state-space form."""

        name, title = "OWN", "Own"
        parameters = (Parameter("q2", "q²", "scale", signal_power=2, scale_power=1),)

        def __init__(self):
            object.__setattr__(self, "q2", 2.0)

        def state_space(self, rate):
            return StateSpace(F=[], Q=[], H=[], R=self.q2)

    where = design(256, levels=[1, 2, 3])
    rows = simulated_variances(Model((Own(),)), where, 600, seed=1)
    assert np.all(np.abs(standard_errors(rows, WN(sigma2=2.0).wavelet_variance(3, 10.0))) < 4)


# --- threads and memory ------------------------------------------------------------------------------


def test_progress_is_told_in_the_callers_thread():
    told = []
    draws = 5 * (DRAWN_SAMPLES // 4096) + 1
    simulated_variances(
        Model((WN(sigma2=1.0),)), design(4096), draws, seed=1,
        progress=lambda done: told.append((done, threading.current_thread())),
    )  # fmt: skip
    numbers = [done for done, _ in told]
    assert numbers == sorted(numbers)
    assert numbers[-1] == draws
    assert {thread for _, thread in told} == {threading.current_thread()}


def test_an_error_ends_all_threads():
    before, told = threading.active_count(), []

    def stop(done):
        told.append(done)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulated_variances(Model((WN(sigma2=1.0),)), design(4096), 10**6, seed=1, threads=3, progress=stop)
    assert threading.active_count() == before
    assert len(told) == 1


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no such signal")
def test_interrupted_soon():
    # A shell that starts the tests in the background has them ignore Ctrl-C.
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    before, start, begun = threading.active_count(), time.process_time(), threading.Event()
    sender = threading.Thread(target=lambda: begun.wait() and os.kill(os.getpid(), signal.SIGINT))
    sender.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            simulated_variances(Model.parse(SUM), design(10**6), 10**6, seed=1, progress=lambda done: begun.set())
    finally:
        signal.signal(signal.SIGINT, handler)
        begun.set()
    sender.join()
    # Alone it takes a tenth of this.
    assert time.process_time() - start < 5
    assert threading.active_count() == before


@pytest.mark.slow
def test_memory_is_some_batches_whatever_the_draws():
    model, peaks = Model.parse(SUM), []
    for draws in (200, 1600):
        tracemalloc.start()
        rows = simulated_variances(model, design(4096), draws, seed=1, threads=2)
        peaks.append(tracemalloc.get_traced_memory()[1] - rows.nbytes)
        tracemalloc.stop()
    # Two threads of three arrays, and the block that is never touched.
    assert max(peaks) < (2 * 4 + 8) * 8 * DRAWN_SAMPLES


# --- the door ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "error", "facts"),
    [
        ({"draws": 0}, OptionError, ("draws", "at least 1", 0)),
        ({"draws": 2.0}, OptionError, ("draws",)),
        ({"draws": True}, OptionError, ("draws",)),
        ({"seed": -1}, OptionError, ("seed", "at least 0", -1)),
        ({"seed": None}, OptionError, ("seed",)),
        ({"seed": 1.5}, OptionError, ("seed",)),
        ({"threads": 0}, OptionError, ("threads",)),
        ({"model": GM(beta=1.0) + WN()}, ModelError, ("GM.sigma2, WN.sigma2",)),
    ],
)
def test_errors(arguments, error, facts):
    given = {"model": Model((RW(gamma2=1.0),)), "design": design(100), "draws": 2, "seed": 1, **arguments}
    with raises(error, *facts):
        simulated_variances(**given)


def test_a_process_that_cannot_be_simulated():
    class Blank(Process, register=False):
        """A wavelet variance and nothing else."""

        name, title = "BLANK", "Blank"
        parameters = (Parameter("q2", "q²", "scale", signal_power=2, scale_power=1),)

        def __init__(self):
            object.__setattr__(self, "q2", 1.0)

        @classmethod
        def shape(cls, nonlinear, levels, rate, filter=None):
            raise AssertionError("not asked for")

    with raises(MissingTheoryError, "BLANK", "simulated"):
        simulated_variances(Model((Blank(),)), design(100), 2, seed=1)
