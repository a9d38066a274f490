"""Upper limits of white noise and random walks that the fitted model does not contain."""

from __future__ import annotations

import math
from collections.abc import Mapping

from gmwm.base.errors import DataError, GmwmError
from gmwm.base.units import noise_unit
from gmwm.choosing.datasheets.entry import Entry
from gmwm.fitting.estimation.estimator import fit_quietly
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.reweighting import REWEIGHTED
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.noise import WN
from gmwm.theory.processes.walk import RW

_KINDS: Mapping[str, type[Process]] = {"N": WN, "K": RW}
"""Process that is added to the model to compute the upper limit of N or K."""


def hidden(fit: Fit, entry: Entry, level: float) -> float:
    """Compute the upper limit, in the unit of the entry N or K, from a fit of the model with this term added. It is
    infinite if the confidence interval is unbounded. Raises DataError if the model with this term cannot be fitted, or
    has no confidence intervals."""
    kind = _KINDS[entry.symbol]
    try:
        holder = fit if any(isinstance(p, kind) for p in fit.model.processes) else _widened(fit, kind)
        intervals = holder.confidence_intervals(level)
    except GmwmError as error:
        message = f"the data give no upper limit of the {entry.title}: {error.reason}"
        raise DataError(message, advice="Record longer.").with_advice_of(error) from error
    pairs = zip(holder.model.terms, holder.model.processes, strict=True)
    term, process = next((t, p) for t, p in pairs if isinstance(p, kind))
    scale = process.scale_parameter().name
    high = process.value(scale) if process.is_fixed(scale) else intervals[f"{term}.{scale}"][1]
    if not math.isfinite(high):
        return math.inf
    wv = fit.wavelet_variance
    number = process.with_values(**{scale: high}).physical(wv.rate)[0]
    return noise_unit(number.time_power, wv.unit)[1] * number.value


def _widened(fit: Fit, kind: type[Process]) -> Fit:
    """Fit the model with a process of class `kind` added to the same data, without warnings that it is zero."""
    weighting = fit.weighting if fit.weighting in REWEIGHTED else fit.weighting_matrix
    return fit_quietly(fit.model + kind(), fit.wavelet_variance, weighting, certify=False)
