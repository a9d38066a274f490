"""Options of a calibration, which are validated when they are created."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from gmwm.base.errors import ModelError, OptionError, ReadError
from gmwm.base.units import sensor_of
from gmwm.choosing.selection.ranking import SLOW, RankingOptions
from gmwm.measuring.regression.against import AUTO, Against, Asked
from gmwm.measuring.variance.biweight import EFFICIENCY, biweight
from gmwm.recording.options import one_of
from gmwm.theory.processes.model import Model, ModelLike, as_model

AGAIN = "Pass an unchanged calibration.json, or calibrate the recording again."
"""Advice of the error if a document is not a calibration or is incomplete."""
SEARCHED = "auto"  # default of `within`: gmwm searches for the model, as `gmwm.selection.search` describes
_SINCE = {"gravity": None, "tilt": None, "warmup": "omit", "repeated": "auto"}
"""Options that files of older versions do not have, and their defaults."""
_SAVED = ("within", "robust", "weighting", "criterion", "confidence", "efficiency", "draws", "seed", "against")


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions:
    """Options of a calibration. `gmwm.calibrate` describes them in detail. All values are validated on construction.

    Attributes
    ----------
    within : "auto", or Model, Process or str
        The largest model, which is converted to a Model, or "auto" for a search.
    robust : "auto", True or False
        Whether the robust wavelet variance is fitted.
    weighting : "diagonal" or "optimal"
        Weights of the fits.
    criterion : "asymptotic" or "bootstrap"
        How the penalty of the information criterion is computed.
    confidence : float
        Confidence level of the intervals and of the model selection, from 0.5 to below 1.
    efficiency : float
        Efficiency of the robust wavelet variance under Gaussian noise.
    draws, seed : int
        Number of simulated records, and seed of their random numbers.
    against : "auto", "none", str, or mapping of name to array
        Conditions whose effect is removed. They are saved as text, without the arrays.
    gravity : float or None
        Local gravity (m/s²); None if it is not known.
    tilt : float or None
        Largest possible angle (°) between the vertical and the accelerometer axis closest to it; None if unknown.
    warmup : "omit" or "keep"
        Whether the beginning of a recording is left out if a warm-up there raises K by more than its uncertainty.
    axes : tuple of str or None
        The axes or sensors to calibrate; None for all. The option is not saved, because a calibration lists its axes.
    models : mapping of axis or sensor to Model
        Models that are fitted without comparing them with others. gmwm chooses the models of the other axes.
    repeated : "auto" or "keep"
        Whether faults of the logger, such as repeated and frozen values, are repaired, and jumps and motion removed.

    Raises
    ------
    OptionError, ModelError
        If a value is not allowed.

    Examples
    --------
    >>> CalibrationOptions(within="WN + RW", axes="gyro").axes
    ('gyro',)
    """

    within: ModelLike = SEARCHED
    robust: Literal["auto"] | bool = "auto"
    weighting: Literal["diagonal", "optimal"] = "optimal"
    criterion: Literal["asymptotic", "bootstrap"] = "asymptotic"
    confidence: float = 0.95
    efficiency: float = EFFICIENCY
    draws: int = 1000
    seed: int = 0
    against: Against = AUTO
    gravity: float | None = None
    tilt: float | None = None
    warmup: Literal["omit", "keep"] = "omit"
    axes: str | Sequence[str] | None = None
    models: Mapping[str, ModelLike] = field(default_factory=dict)
    repeated: Literal["auto", "keep"] = "auto"

    def __post_init__(self) -> None:
        if not isinstance(self.robust, bool) and self.robust != "auto":
            raise OptionError(argument="robust", expected="'auto', False or True", got=self.robust)
        one_of(self.warmup, "warmup", ("omit", "keep"))
        one_of(self.repeated, "repeated", ("auto", "keep"))
        _ = self.ranking  # validates its options
        biweight(self.efficiency)
        for name, low, high, unit in (("gravity", 9.7, 9.9, "m/s²"), ("tilt", 0.0, 10.0, "degrees")):
            value = getattr(self, name)
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if value is not None and not (number and low <= value <= high):
                raise OptionError(argument=name, expected=f"a number from {low:g} to {high:g} ({unit})", got=value)
        if not self.searched:
            object.__setattr__(self, "within", as_model(self.within, "within"))
        _ = self.conditions  # validates the text and the arrays
        object.__setattr__(self, "axes", _checked_axes(self.axes))
        models = self.models
        if not isinstance(models, Mapping) or not all(isinstance(axis, str) for axis in models):
            expected = "a mapping of axis or sensor to model, for example {'gyro_x': '2*GM + WN'}"
            raise OptionError(argument="models", expected=expected, got=models)
        object.__setattr__(self, "models", {axis: as_model(model, "models") for axis, model in models.items()})

    @property
    def general(self) -> Model:
        """The largest model. For a search, the largest model of the first step."""
        return as_model(SLOW if self.searched else self.within)

    @property
    def searched(self) -> bool:
        """Whether gmwm searches for the model."""
        return isinstance(self.within, str) and self.within == SEARCHED

    def of_axis(self, axis: str) -> CalibrationOptions:
        """Return the options of one axis: a model for it or its sensor becomes `within`, and `models` has only this
        one."""
        model = self.models.get(axis, self.models.get(sensor_of(axis)))
        if model is None:
            return replace(self, models={})
        return replace(self, within=model, models={axis: model})

    def gives_all(self, axes: Iterable[str]) -> bool:
        """Whether `models` has a model for each of these axes or its sensor, so that `within` has no effect."""
        return all(axis in self.models or sensor_of(axis) in self.models for axis in axes)

    @property
    def ranking(self) -> RankingOptions:
        """Options of the model selection."""
        return RankingOptions(
            weighting=self.weighting, criterion=self.criterion, confidence=self.confidence, draws=self.draws,
            seed=self.seed,
        )  # fmt: skip

    @property
    def conditions(self) -> Asked:
        """The parsed option `against`: the conditions whose effect is removed."""
        return Asked.of(self.against)

    @property
    def wanted(self) -> tuple[str, ...] | None:
        """The axes or sensors to calibrate as a tuple; None for all."""
        return _checked_axes(self.axes)

    def to_dict(self) -> dict[str, Any]:
        """Return the options as the numbers and strings that are saved in calibration.json."""
        return {name: getattr(self, name) for name in (*_SAVED, *_SINCE)} | {
            "within": str(self.within),
            "against": str(self.conditions),
            "repeated": self.repeated,
            "models": {axis: str(model) for axis, model in self.models.items()},
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> CalibrationOptions:
        """Restore the options from `content`, the result of `to_dict`, or raise a ReadError."""
        for name in _SAVED:
            if name not in content:
                raise ReadError(f"the calibration is incomplete: settings has no {name!r}", advice=AGAIN)
        try:
            later = {name: content.get(name, default) for name, default in _SINCE.items()}
            later["models"] = content.get("models", {})
            return cls(**{name: content[name] for name in _SAVED} | later)
        except (OptionError, ModelError) as error:
            raise ReadError(f"not a calibration: settings.{error.reason}", advice=AGAIN) from error


def _checked_axes(axes: str | Sequence[str] | None) -> tuple[str, ...] | None:
    """Return the axes as a tuple of names. `chosen_axes` checks later that the recording has them."""
    if axes is None or isinstance(axes, str):
        return None if axes is None else (axes,)
    if not isinstance(axes, Sequence) or not axes or not all(isinstance(name, str) for name in axes):
        expected = "a list of axes or sensors of the recording, for example ['gyro', 'accel_z']"
        raise OptionError(argument="axes", expected=expected, got=axes)
    return tuple(axes)
