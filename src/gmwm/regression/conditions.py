"""The regression of all axes of a recording on its conditions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gmwm._arrays import Vector
from gmwm._threads import in_threads
from gmwm.batches import Batch, Streamed
from gmwm.errors import DataError, GmwmError, OptionError
from gmwm.regression.against import TEMPERATURE, Asked, Term
from gmwm.regression.api import effect_of, regress, without
from gmwm.regression.covariates import Covariates
from gmwm.regression.result import Regression
from gmwm.signals import Imu, Signal
from gmwm.variance.api import signal_wavelet_variance
from gmwm.variance.biweight import EFFICIENCY
from gmwm.variance.result import WaveletVariance


@dataclass(frozen=True, eq=False)
class Conditions:
    """The conditions of a recording, and the regression of each axis.

    Attributes
    ----------
    covariates : Covariates or None
        None if there is nothing to regress on.
    found : mapping of axis to Regression
        Also those that are not applied, because the axis does not follow the temperature.
    unknown : str
        Why the temperature of the recording cannot be used; "" if it can, or if there is none.
    """

    covariates: Covariates | None = None
    found: Mapping[str, Regression] = field(default_factory=dict)
    unknown: str = ""

    @classmethod
    def of(
        cls, signals: Mapping[str, Signal], asked: Asked, temperature: Vector | None, *, threads: int | None = None
    ) -> Conditions:
        """Regress the axes of a recording, which have the same clock.

        With the automatic choice, an axis that cannot be regressed has no regression.

        Raises
        ------
        OptionError, DataError
            If a covariate that was asked for is missing or cannot be used.
        """
        if not signals or not (asked.terms or (asked.automatic and temperature is not None)):
            return cls()
        if asked.automatic and temperature is not None and np.ptp(temperature) == 0:
            return cls()  # a constant temperature has no effect
        first = next(iter(signals.values()))
        arrays = dict(asked.arrays or {})
        if temperature is not None:
            arrays.setdefault(TEMPERATURE, temperature)
        terms = (Term(TEMPERATURE),) if asked.automatic else asked.terms
        try:
            covariates = Covariates.of(terms, arrays, first)
        except DataError as error:
            if not asked.automatic:
                raise
            return cls(unknown=error.reason)

        def work(axis: str, signal: Signal) -> Regression | None:
            try:
                return regress(signal, covariates, automatic=asked.automatic)
            except OptionError:
                raise
            except GmwmError:
                if not asked.automatic:
                    raise
                return None

        found = in_threads(work, signals, threads=threads)
        return cls(covariates, {axis: one for axis, one in found.items() if one is not None})

    @classmethod
    def of_recording(cls, recording: Imu | Streamed, asked: Asked, *, threads: int | None = None) -> Conditions:
        """Regress all axes of a recording, see `of`; a recording in chunks has no temperature.

        Raises
        ------
        OptionError
            Also if a covariate was asked for, and the recording is not in memory.
        """
        if isinstance(recording, Imu):
            return cls.of(recording.signals, asked, recording.temperature, threads=threads)
        if asked.terms:
            raise OptionError(
                "against needs the recording in memory; got a Stream",
                argument="against",
                advice="Read the recording with `gmwm.read(path)`, or with {--chunked=no}.",
            )
        return cls()

    def applied(self, axis: str) -> Regression | None:
        """The regression of an axis whose effect is removed; None for none."""
        found = self.found.get(axis)
        return found if found is not None and found.applied else None

    def without(self, axis: str, signal: Signal) -> Signal:
        """The signal of an axis without the effect of the conditions."""
        found = self.applied(axis)
        return signal if found is None or self.covariates is None else without(signal, found, self.covariates)

    def batch(self, batch: Batch) -> Batch:
        """The samples of a batch without the effect of the conditions."""
        if self.covariates is None or not any(found.applied for found in self.found.values()):
            return batch
        signals = {}
        for axis, signal in batch.signals.items():
            found = self.applied(axis)
            signals[axis] = signal if found is None else without(signal, found, self.covariates, batch.first)
        return Batch(signals, batch.first, batch.continues)

    def curve(self, axis: str, signal: Signal, robust: bool = False, efficiency: float = EFFICIENCY) -> WaveletVariance:
        """The wavelet variance of an axis without the effect of the conditions."""
        found = self.applied(axis)
        wv = signal_wavelet_variance(self.without(axis, signal), robust=robust, efficiency=efficiency)
        return wv if found is None else found.corrected(wv)

    def effect(self, axis: str, indices: Sequence[int]) -> Vector:
        """The effect of the conditions on an axis at some samples."""
        found = self.applied(axis)
        if found is None or self.covariates is None:
            return np.zeros(len(indices))
        at = [effect_of(found, self.covariates, k, k + 1)[0] for k in indices]
        return np.array(at, dtype=np.float64)


NOTHING = Conditions()
"""No conditions."""
