"""Regression on conditions (such as temperature) within a maximum-likelihood fit.

The coefficients follow from generalised least squares with the covariance of the fitted noise model. Like the level of
the recording, they have a flat prior and are integrated out. The result is the restricted likelihood (REML), which
accounts for the degrees of freedom that the regression columns use.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector, as_rate, as_vector
from gmwm.fitting.likelihood.problem import LikelihoodProblem
from gmwm.fitting.likelihood.record import Record
from gmwm.fitting.likelihood.search import Maximum
from gmwm.measuring.regression.against import Asked
from gmwm.measuring.regression.api import regress, restate
from gmwm.measuring.regression.covariates import Covariates
from gmwm.measuring.regression.result import Regression
from gmwm.recording.signals import Signal


@dataclass(frozen=True, eq=False)
class Regressed:
    """A recording, its conditions, a first regression by wavelet levels, whose estimate of the time constant of a
    warm-up is used in the columns, and the recording for the Kalman filter with these columns."""

    signal: Signal
    covariates: Covariates
    first: Regression
    record: Record

    @classmethod
    def of(cls, data: Signal | ArrayLike, rate: float | None, record: Record, asked: Asked) -> Regressed:
        """Compute the regression columns at every sample; raises DataError or OptionError if a covariate cannot be
        used."""
        signal = data if isinstance(data, Signal) else Signal(as_vector(data, "data"), as_rate(rate))
        covariates = Covariates.of(asked.terms, dict(asked.arrays or {}), signal)
        first = regress(signal, covariates)
        columns = np.zeros((len(first), record.values.size))
        observed = np.isfinite(record.values)
        for k, unit in enumerate(np.eye(len(first))):
            columns[k, observed] = covariates.effect(unit, first.tau, 0, len(signal))
        # The restricted likelihood must not depend on the unit of a covariate.
        scales = np.std(columns[:, observed], axis=1)
        record = replace(record, columns=columns / scales[:, None], scales=scales, names=tuple(first))
        return cls(signal, covariates, first, record)

    def regression(self, problem: LikelihoodProblem, found: Maximum) -> Regression:
        """Return the regression at a maximum of the likelihood: coefficients, covariance and degrees of freedom."""
        # Step of a coordinate for the derivative that gives the degrees of freedom of standard errors.
        distance = 0.05
        estimates, covariance = self._at(problem, found.z)
        relative = np.zeros((len(estimates) + 1, len(found.active)))
        inverse = np.linalg.inv(covariance)
        for a, k in enumerate(found.active):
            step = np.zeros(found.z.size)
            step[k] = distance
            slope = (self._at(problem, found.z + step)[1] - self._at(problem, found.z - step)[1]) / (2 * distance)
            relative[:-1, a] = np.diag(slope) / np.diag(covariance)
            relative[-1, a] = np.trace(inverse @ slope) / len(estimates)
        information = found.evaluation.information
        spread = np.zeros(len(relative))
        if information.shape == (len(found.active),) * 2:
            spread = np.einsum("ia,ab,ib->i", relative, np.linalg.pinv(information, hermitian=True), relative)
        freedoms = 2 / np.clip(spread, 2e-6, 2.0)
        return restate(
            self.first, self.signal, self.covariates, estimates, covariance=covariance,
            freedoms=tuple(freedoms[:-1].tolist()), freedom=float(freedoms[-1]),
        )  # fmt: skip

    def _at(self, problem: LikelihoodProblem, z: Vector) -> tuple[Vector, np.ndarray]:
        """Return the coefficients (p,) and their covariance (p, p) for the noise model at coordinates z."""
        level = problem.value(problem.at_point(z))[1]
        part, scales = slice(len(level.values) - len(self.first), None), self.record.scales
        return level.values[part] / scales, level.covariance[part, part] / np.outer(scales, scales)
