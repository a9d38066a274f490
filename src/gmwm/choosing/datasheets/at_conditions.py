"""Numbers of a filter at several values of a condition, such as the temperature or the rate of a turntable."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gmwm.choosing.datasheets.effective import DEFAULT_HORIZON_S, checked_horizon
from gmwm.choosing.datasheets.filter_numbers import filter_numbers
from gmwm.fitting.estimation.conditions_fit import ConditionsFit

if TYPE_CHECKING:
    from polars import DataFrame


def numbers_at(
    fit: ConditionsFit, conditions: Sequence[float] | None = None, *, horizon: float = DEFAULT_HORIZON_S
) -> DataFrame:  # fmt: skip
    """Compute the white noise N and the random walk K of a filter, and correlation times, at values of a condition.

    A program that measures the condition interpolates in this table, and changes N, K and T_c of its filter with it.

    Parameters
    ----------
    fit : ConditionsFit
        Fit to recordings at known conditions, or to one recording during which the condition moves.
    conditions : sequence of float, optional
        Values of the condition within the range of the data; those of the curves by default.
    horizon : float
        Horizon (s) of N and K; see `effective_noise`.

    Returns
    -------
    polars.DataFrame
        Columns: the condition; N in the unit of the signal per √Hz; K in this unit per √s; "T_c of …" (s) of each
        Gauss-Markov term.

    Raises
    ------
    OptionError
        If a condition is outside the range of the data, or the horizon is not a positive time.

    Examples
    --------
    >>> import numpy as np, gmwm
    >>> rng = np.random.default_rng(1)
    >>> recordings = {c: gmwm.Signal(s * rng.normal(size=20_000), 100.0) for c, s in ((0.0, 1.0), (2.0, 3.0))}
    >>> fit = gmwm.fit("WN", recordings, varies={"WN": "1 + rate**2"})
    >>> numbers_at(fit, [0.0, 1.0, 2.0])["N"].round(2).to_list()
    [0.1, 0.17, 0.3]
    """
    from polars import DataFrame

    seconds, rate = checked_horizon(horizon), next(iter(fit.curves.values())).rate
    rows = []
    for condition in fit.curves if conditions is None else conditions:
        model = fit.at(condition)
        numbers = filter_numbers(model.processes, rate, seconds)
        times = {
            f"T_c of {term}": process.correlation_time(rate)
            for term, process in zip(model.terms, model.processes, strict=True)
            if process.parametrises is not None
        }
        rows.append({fit.condition: float(condition), "N": numbers.N, "K": numbers.K, **times})
    return DataFrame(rows)
