"""Recordings of known models, measured and fitted: what the studies of intervals and tests have in common.

A recording is drawn and measured once and fitted with every weighting. Fits run on all processors; what comes out does
not depend on how many there are.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

import gmwm
from gmwm.fitting.estimation.simulated_curves import simulated_variances
from gmwm.measuring.covariance import Design

RATE = 100.0
SAMPLES = 100_000
LEVELS = SAMPLES.bit_length() - 1

TRUTHS = (
    "WN(sigma2=4e-6) + RW(gamma2=1e-10)",
    "GM(beta=0.5, sigma2=2e-7) + WN(sigma2=4e-6)",
    "GM(beta=8.0, sigma2=1e-6) + WN(sigma2=4e-6) + RW(gamma2=4e-10)",
    "GM(beta=8.0, sigma2=6e-7) + GM(beta=0.15, sigma2=2e-7) + WN(sigma2=2e-6) + QN(q2=1e-6)",
    "DR(omega=2e-7) + WN(sigma2=4e-6) + RW(gamma2=5e-11)",
)
"""Models whose every parameter the recordings show, with a relative standard error of at most 0.3."""

WEIGHTINGS: tuple[Literal["diagonal", "optimal"], ...] = ("diagonal", "optimal")

LEAST_SHARED = 200
"""Fits from which on more processes are worth their start."""

SEED = 20261201
"""Of the recordings that the studies of coverage and of goodness of fit have in common."""

Array = NDArray[np.float64]
Item = TypeVar("Item")
Result = TypeVar("Result")


def design() -> Design:
    """How every recording is measured."""
    return Design(np.arange(1, LEVELS + 1), samples=SAMPLES, rate=RATE)


def truths(reduced: bool) -> tuple[str, ...]:
    """The models of a study, or the two of them whose fits take least time."""
    return TRUTHS[:2] if reduced else TRUTHS


def count(reduced: bool) -> int:
    """How many recordings of each."""
    return 20 if reduced else 1000


@cache
def simulated(text: str, count: int, seed: int) -> Array:
    """Wavelet variances (count, J) of recordings of the model `text`."""
    return simulated_variances(gmwm.Model.parse(text).sorted(RATE), design(), count, seed)


def fitted(structure: str, variance: Array, weighting: str, samples: int = SAMPLES, rate: float = RATE) -> gmwm.Fit:
    """The fit of a model without values to one recording; a term that it does not show is part of what is studied."""
    wv = gmwm.WaveletVariance.from_values(variance, samples=samples, rate=rate)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gmwm.errors.FitWarning)
        return gmwm.fit(structure, wv, weighting=weighting, certify=False)


def outcome(structure: str, weighting: str, variance: Array, *, samples: int = SAMPLES, rate: float = RATE) -> Array:
    """All that is asked of one fit: (5, p) estimates, standard errors, ends of the intervals at 95 %, and p-value.

    NaN stands for a standard error that there is not.
    """
    fit = fitted(structure, variance, weighting, samples, rate)
    ends, errors = fit.confidence_intervals(), fit.standard_errors
    pvalue = fit.goodness_of_fit().pvalue
    rows = [(value, errors.get(name, np.nan), *ends[name], pvalue) for name, value in fit.parameters.items()]
    return np.array(rows).T


@cache
def outcomes(text: str, weighting: str, count: int) -> Array:
    """`outcome` (count, 5, p) of recordings of one of `TRUTHS`, each fitted by the model that it comes from."""
    structure = gmwm.Model.parse(text).sorted(RATE).structure
    drawn = simulated(text, count, SEED + TRUTHS.index(text))
    return np.array(everywhere(partial(outcome, structure, weighting), drawn))


def everywhere(
    task: Callable[[Item], Result], items: Sequence[Item] | NDArray[Any], least: int = LEAST_SHARED
) -> list[Result]:
    """What `task` makes of each item, in order; `least` or more are shared among the processors."""
    if len(items) < least:
        return [task(item) for item in items]
    return list(_processes().map(task, items, chunksize=10 if len(items) >= LEAST_SHARED else 1))


@cache
def _processes() -> ProcessPoolExecutor:
    """One pool for all studies: to start a process takes as long as many fits."""
    return ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn"))
