"""Hold the noise numbers of one axis as datasheets and filters state them, and convert them to a noise model."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gmwm.base.errors import ModelError, OptionError
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.markov import GM
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.noise import QN, WN
from gmwm.theory.processes.power import FN
from gmwm.theory.processes.walk import DR, RW

FLOOR = math.sqrt(2 * math.log(2) / math.pi)
"""Allan deviation of flicker noise with the coefficient 1 (IEEE Std 952)."""
GAUSS_MARKOV_PEAK = 0.6173643
"""Largest Allan deviation of a Gauss-Markov process of variance 1. It occurs at an averaging time of 1.89 times the
correlation time (pinned by tests/importers/test_values.py)."""
_SQUARED = (1e-150, 1e150)
"""Range of numbers whose squares are floating-point numbers at any sampling rate."""


@dataclass(frozen=True, kw_only=True)
class Values:
    """The noise numbers of one axis, in SI units; None for a number that is not given.

    Attributes
    ----------
    N : float or None
        White noise density: rad/s/√Hz, m/s²/√Hz.
    K : float or None
        Random walk of the bias: rad/s/√s, m/s²/√s.
    B : float or None
        Bias instability: rad/s, m/s². Without `time` it is the coefficient of flicker noise, whose Allan deviation is
        0.664 B. With `time` it is a Gauss-Markov process whose largest Allan deviation is 0.664 B.
    sigma : float or None
        Standard deviation of a Gauss-Markov process, which needs `time`: rad/s, m/s².
    time : float or None
        Correlation time of the Gauss-Markov process (s).
    Q : float or None
        Quantization noise: rad, m/s.
    R : float or None
        Rate ramp: rad/s², m/s³.
    """

    N: float | None = None
    K: float | None = None
    B: float | None = None
    sigma: float | None = None
    time: float | None = None
    Q: float | None = None
    R: float | None = None

    def model(self, rate: float) -> Model:
        """Return the noise model with these numbers at a sampling rate (Hz).

        At the rate f, white noise has σ² = N² f, a random walk γ² = K²/f, flicker noise b² = B², quantization noise q²
        = Q² f², and a drift ω = R/f. A Gauss-Markov process has the variance σ² and β = 1/`time`.

        Raises
        ------
        ModelError
            If no number is positive, or the square of a number is not a floating-point number.

        Examples
        --------
        >>> Values(N=1e-4, K=1e-6).model(rate=100.0)
        Model('WN(sigma2=1e-06) + RW(gamma2=1e-14)')
        """
        smallest, largest = _SQUARED
        for name, value in vars(self).items():
            if value and not smallest < abs(value) < largest:
                raise ModelError(f"{name} must be between {smallest:g} and {largest:g} in SI units; got {value:g}")
        processes: list[Process] = []
        if self.N:
            processes.append(WN(sigma2=_product(self.N, self.N, rate)))
        if self.Q:
            processes.append(QN(q2=_product(self.Q, self.Q, rate, rate)))
        if self.time and (self.sigma or self.B):
            sigma = self.sigma if self.sigma else (self.B or 0.0) * FLOOR / GAUSS_MARKOV_PEAK
            processes.append(GM(beta=1.0 / self.time, sigma2=sigma**2))
        elif self.B:
            processes.append(FN(b2=self.B**2))
        if self.K:
            processes.append(RW(gamma2=float(f"{self.K**2 / rate:.15g}")))
        if self.R:
            processes.append(DR(omega=self.R / rate))
        if not processes:
            raise ModelError("there is no noise: every number is zero", advice="Give N, such as N=0.15deg/√h.")
        return Model(tuple(processes))

    def merged(self, other: Values) -> Values:
        """Return the numbers together with the numbers of `other`.

        Raises
        ------
        OptionError
            If a number is given twice.
        """
        numbers = {name: value for name, value in vars(other).items() if value is not None}
        if twice := [name for name in numbers if getattr(self, name) is not None]:
            raise OptionError(argument="source", expected=f"{twice[0]} once for each axis", got=twice[0])
        return replace(self, **numbers)


def _product(*factors: float) -> float:
    """Return a product without the rounding error of its last digit, for readable models."""
    return float(f"{math.prod(factors):.15g}")
