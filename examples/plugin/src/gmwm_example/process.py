"""A process: a bias that changes smoothly."""

import math
from dataclasses import dataclass

import numpy as np
from gmwm.processes import Parameter, Physical, Process, Value
from gmwm.statespace import StateSpace

NODES, WEIGHTS = np.polynomial.legendre.leggauss(20)


@dataclass(frozen=True, repr=False)
class GM2(Process):
    """Gauss-Markov process of second order: b'' + 2βb' + β²b = w, Var b = σ²."""

    name = "GM2"
    title = "Second-order Gauss-Markov process"
    parameters = (
        Parameter("beta", "β", "inverse correlation time", time_power=-1),
        Parameter("sigma2", "σ²", "marginal variance", signal_power=2, scale_power=1),
    )
    repeatable = True

    beta: Value = None
    sigma2: Value = None

    def state_space(self, rate: float) -> StateSpace:
        """States (b, b'), discretized exactly. Q is an integral, because P0 − F P0 Fᵀ cancels for small βΔt."""
        beta, s2, dt = self.value("beta"), self.scale, 1.0 / rate
        x = beta * dt
        F = math.exp(-x) * np.array([[1.0 + x, dt], [-beta * x, 1.0 - x]])
        s = 0.5 * dt * (NODES + 1.0)
        response = math.sqrt(4.0 * beta**3 * s2) * np.exp(-beta * s) * np.array([s, 1.0 - beta * s])
        Q = (response * (0.5 * dt * WEIGHTS)) @ response.T
        return StateSpace(F=F, Q=Q, H=[1.0, 0.0], P0=np.diag([s2, beta**2 * s2]))

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """T_c = 1/β, with the derivative ∂ ln T_c/∂ ln β for its confidence interval."""
        time = 1.0 / self.value("beta")
        return (Physical("T_c", "correlation time", time, 1.0, signal_power=0, slopes={"beta": -1.0}),)
