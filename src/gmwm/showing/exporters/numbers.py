"""Export as JSON: the datasheet, N and K for a filter, and the state-space matrices of a unit."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from gmwm.base.documents import plain
from gmwm.base.errors import DataError
from gmwm.base.text import version
from gmwm.base.units import SI_UNIT, find_unit, noise_unit
from gmwm.choosing.datasheets.effective import Use
from gmwm.showing.exporters.base import Exporter, ExportOptions, register
from gmwm.showing.exporters.reduction import axis_noise
from gmwm.showing.exporters.statespace import axis_matrices, has_matrices
from gmwm.showing.exporters.text import checksums

if TYPE_CHECKING:
    from gmwm.calibration import Calibration

FORMAT = "gmwm-numbers"


@register
class JsonNumbers(Exporter):
    """JSON with the noise parameters of a calibration, for other programs. calibration.json has the complete
    calibration."""

    name = "json"
    title = "other programs (JSON)"
    extension = ".json"
    takes = frozenset({"horizon", "duration"})

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of the JSON document."""
        content = {
            "format": FORMAT,
            "version": 1,
            "gmwm": version(),
            "source": calibration.source_name,
            "sha256": checksums(calibration),
            "about": "SI units. Continuous time, except the parameters (per sample, beta in 1/s) and the matrices F, "
            "Q, H, R, P0 (steps of one sample). Each axis by itself, without inflation. filter: N and K for the "
            "horizon; if upper_limit is true, the number is an upper limit. matrices.two_states: white noise and the "
            "two Gauss-Markov states that are nearest to the Allan deviation from the horizon to the duration; error "
            "is the largest relative difference, error_of_one that of one state, error_of_walk that of N and K.",
            "horizon": options.horizon,
            "confidence": calibration.settings.confidence,
            "axes": {axis: _axis(axis, calibration, options) for axis in calibration},
            "failed": dict(calibration.failed),
            "remarks": [remark.to_dict() for remark in self.remarks(calibration, options)],
        }
        return json.dumps(plain(content), allow_nan=False, ensure_ascii=False, indent=1) + "\n"


def _axis(axis: str, calibration: Calibration, options: ExportOptions) -> dict[str, Any]:
    found = calibration.axes[axis]
    fit, wv = found.fit, found.fit.wavelet_variance
    units = fit.model.units(wv.unit or "u")
    return {
        "model": fit.model.structure,
        "rate": wv.rate,
        "samples": wv.samples,
        "unit": wv.unit,
        "parameters": {
            name: {"value": value, "interval": found.intervals.get(name), "unit": units[name]}
            for name, value in fit.parameters.items()
        },
        "datasheet": [entry.to_dict() for entry in found.datasheet.entries],
        "bias": None if found.rest is None else found.rest.to_dict(),
        "filter": _filter(axis, calibration, options),
        "matrices": axis_matrices(axis, calibration, options) if has_matrices(fit.model, wv.rate) else None,
    }


def _filter(axis: str, calibration: Calibration, options: ExportOptions) -> dict[str, Any] | None:
    """Return N and K of an axis with their units, or the reason why they do not exist."""
    fit = calibration[axis]
    unit = find_unit(fit.wavelet_variance.unit)
    if unit is None:
        return {"none_because": "the unit of the signal is unknown"}
    try:
        use, level = Use(options.horizon), calibration.settings.confidence
        noise = axis_noise(axis, calibration.axes[axis], quantity=unit.quantity, use=use, level=level)
    except DataError as error:
        return {"none_because": str(error)}
    return {
        symbol: {
            "value": number.value, "upper_limit": number.upper, "unit": noise_unit(power, SI_UNIT[unit.quantity])[0],
        }
        for symbol, number, power in (("N", noise.N, 0.5), ("K", noise.K, -0.5))
    }  # fmt: skip
