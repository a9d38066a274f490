"""Autoregressive moving averages of any order, with or without a season (φ, θ and alike Φ, Θ):

φ(B) Φ(B^s) X_t = θ(B) Θ(B^s) ε_t, Var ε = σ², φ(B) = 1 − φ₁B − … − φ_p B^p, θ(B) = 1 + θ₁B + … + θ_q B^q."""

from __future__ import annotations

from itertools import product

from gmwm.base.errors import ModelError
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.linear_recursion import PHI, SEASONAL_PHI, SEASONAL_THETA, THETA, Lagged


class _Arma(Lagged, abstract=True, listed=False):
    """Special cases of AR, MA, ARMA and SARMA classes, and the class that contains two given ones as special cases."""

    @classmethod
    def instead_of_repeats(cls, count: int) -> str:
        """Return the term for `count` terms: sums of autoregressions are ARMA processes, of moving averages MA."""
        p, q, seasonal_p, seasonal_q, _ = cls.full_orders()
        if p + seasonal_p == 0 or seasonal_p + seasonal_q > 0:
            return cls.name
        return f"{ARMA.name}({count * p},{(count - 1) * p + q})"

    @classmethod
    def smaller(cls) -> tuple[type[Process], ...]:
        """Return the classes of lower orders, largest orders first; white noise, with all orders 0, is not included."""
        p, q, seasonal_p, seasonal_q, period = cls.full_orders()
        lower = product(*(range(order, -1, -1) for order in (p, q, seasonal_p, seasonal_q)))
        return tuple(_of_orders(at, period) for at in lower if any(at) and at != (p, q, seasonal_p, seasonal_q))

    @classmethod
    def joined(cls, other: type[Process]) -> type[Process] | None:
        """Return the class whose orders are the larger ones of both classes; None if the periods differ."""
        if not issubclass(other, _Arma):
            return None
        orders, other_orders = cls.full_orders(), other.full_orders()
        period, second = orders[-1], other_orders[-1]
        if 1 not in (period, second) and period != second:
            return None
        return _of_orders(tuple(map(max, orders[:-1], other_orders[:-1])), max(period, second))


class AR(_Arma, abstract=True):
    """Autoregression of order p: X_t = φ₁X_{t−1} + … + φ_p X_{t−p} + ε_t, Var ε = σ².

    Parameters
    ----------
    p : int
        Order, from 1. Leave it out if `phi` is given.
    phi1, …, phip : float, fixed or None
        Coefficients; pass all of them as a list with `phi`. The process must be stationary: 1 − φ₁z − … − φ_p z^p must
        have no zero with |z| ≤ 1.
    sigma2 : float, fixed or None
        Innovation variance σ² (u²).

    References
    ----------
    Brockwell, P. J. and Davis, R. A. (1991), Time Series: Theory and Methods, 2nd ed., Springer, chapter 3.

    Examples
    --------
    >>> AR(2)
    AR(2)
    >>> AR(phi=[1.4, -0.6], sigma2=1.0).wavelet_variance(3, rate=100.0).round(6)
    array([0.416667, 1.0625  , 1.958425])
    """

    name = "AR"
    title = "Autoregression"
    polynomials = (PHI,)
    examples = ((2,),)

    @classmethod
    def check_orders(cls, orders: tuple[int, ...]) -> None:
        """Refuse the order 0."""
        if orders[0] < 1:
            raise ModelError(f"p of {cls.written()} must be at least 1; got 0", argument="p", got=orders[0])


class MA(_Arma, abstract=True):
    """Moving average of order q: X_t = ε_t + θ₁ε_{t−1} + … + θ_q ε_{t−q}, Var ε = σ².

    For the order 1 and the Haar filter ν_j² = σ²[(1 + θ)²τ − 6θ]/τ², with τ = 2^j samples.

    Parameters
    ----------
    q : int
        Order, from 1. Leave it out if `theta` is given.
    theta1, …, thetaq : float, fixed or None
        Coefficients; pass all of them as a list with `theta`. The process must be invertible: 1 + θ₁z + … + θ_q z^q
        must have no zero with |z| ≤ 1.
    sigma2 : float, fixed or None
        Innovation variance σ² (u²).

    Examples
    --------
    >>> MA(theta=[0.5], sigma2=4.0).wavelet_variance(2, rate=100.0)
    array([1.5, 1.5])
    """

    name = "MA"
    title = "Moving average"
    polynomials = (THETA,)
    examples = ((1,),)

    @classmethod
    def check_orders(cls, orders: tuple[int, ...]) -> None:
        """Refuse the order 0."""
        if orders[0] < 1:
            raise ModelError(f"q of {cls.written()} must be at least 1; got 0", argument="q", got=orders[0])


class ARMA(_Arma, abstract=True):
    """Autoregressive moving average: X_t = Σ φ_i X_{t−i} + ε_t + Σ θ_i ε_{t−i}, Var ε = σ².

    Parameters
    ----------
    p, q : int
        Orders, from 1. Leave them out if `phi` and `theta` are given.
    phi1, …, phip, theta1, …, thetaq : float, fixed or None
        Coefficients of a stationary and invertible process; pass all of them as lists with `phi` and `theta`.
    sigma2 : float, fixed or None
        Innovation variance σ² (u²).

    Examples
    --------
    >>> ARMA(2, 1).values
    {'phi1': None, 'phi2': None, 'theta1': None, 'sigma2': None}
    >>> ARMA(phi=[1.4, -0.6], theta=[0.3], sigma2=1.0)
    ARMA(2, 1, phi1=1.4, phi2=-0.6, theta1=0.3, sigma2=1.0)
    """

    name = "ARMA"
    title = "Autoregressive moving average"
    polynomials = (PHI, THETA)
    examples = ((2, 1),)

    @classmethod
    def check_orders(cls, orders: tuple[int, ...]) -> None:
        """Raise ModelError if an order is 0, because the process is then an AR or an MA."""
        p, q = orders
        if p == 0 or q == 0:
            simpler = f"{AR.name}({p})" if p else f"{MA.name}({q})" if q else f"{cls.name}(1, 1)"
            raise ModelError(
                f"p and q of {cls.written()} must be at least 1; got {p} and {q}", got=(p, q),
                advice="Write `{simpler}`.", simpler=simpler,
            )  # fmt: skip


class SARMA(_Arma, abstract=True):
    """Seasonal ARMA with a period of s samples: φ(B) Φ(B^s) X_t = θ(B) Θ(B^s) ε_t.

    Parameters
    ----------
    p, q, P, Q, period : int
        Orders of φ, θ, Φ and Θ, from 0, with P or Q at least 1, and the period s (samples), from 2. Leave the orders
        out if the coefficients are given as lists with `phi`, `theta`, `sphi` and `stheta`.
    phi1, …, theta1, …, sphi1, …, stheta1, … : float, fixed or None
        Coefficients; each polynomial must be stationary or invertible.
    sigma2 : float, fixed or None
        Innovation variance σ² (u²).

    Examples
    --------
    >>> SARMA(1, 0, 1, 0, period=12)
    SARMA(1,0,1,0,12)
    >>> SARMA(phi=[0.5], sphi=[0.9], period=12, sigma2=1.0)
    SARMA(1, 0, 1, 0, 12, phi1=0.5, sphi1=0.9, sigma2=1.0)
    """

    name = "SARMA"
    title = "Seasonal autoregressive moving average"
    polynomials = (PHI, THETA, SEASONAL_PHI, SEASONAL_THETA)
    period_name = "period"
    examples = ((1, 1, 1, 0, 4),)

    @classmethod
    def check_orders(cls, orders: tuple[int, ...]) -> None:
        """Raise ModelError if P = Q = 0, because the process then has no season."""
        p, q, seasonal_p, seasonal_q, _ = orders
        if seasonal_p + seasonal_q == 0:
            simpler = f"{ARMA.name}({p}, {q})" if p and q else f"{AR.name}({p})" if p else f"{MA.name}({max(q, 1)})"
            raise ModelError(
                f"P or Q of {cls.written()} must be at least 1; got 0 and 0", got=(0, 0), advice="Write `{simpler}`.",
                simpler=simpler,
            )  # fmt: skip


def _of_orders(orders: tuple[int, ...], period: int) -> type[_Arma]:
    """Return the class of the simplest process with the orders p, q, P and Q."""
    p, q, seasonal_p, seasonal_q = orders
    if seasonal_p + seasonal_q:
        return SARMA.of(p, q, seasonal_p, seasonal_q, period)
    if p and q:
        return ARMA.of(p, q)
    return AR.of(p) if p else MA.of(q)
