"""Wavelet filters: coefficients, squared gain and autocorrelation.

A filter has L scaling coefficients g, Σ g = √2, Σ g² = 1, orthogonal to even shifts, and wavelet coefficients h_l =
(−1)^l g_{L−1−l}. The maximal-overlap transform has g/√2 and h/√2, upsampled by 2^(j−1): L_j = (2^j − 1)(L − 1) + 1 taps
of sum 0 and square sum 2^−j.

Published tables have printed digits only. The nearest filter that satisfies the equations, with vanishing moments,
replaces each (`adjustment`: largest change). A table at the end of this file adds a filter, also to the tests."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Matrix, Vector, as_levels, freeze
from gmwm.base.errors import OptionError
from gmwm.base.extras import library

__all__ = ["WaveletFilter", "find_filter"]

_MOST_LAGS = 64
"""Largest lag of differences' autocovariance, for average roots up to 0.95 (docs/validation/efficiency.md)."""
_DEPENDENT = 1e-12
"""Singular values below this share of the largest one are treated as zero: they belong to redundant equations."""


@dataclass(frozen=True, eq=False, repr=False)
class WaveletFilter:
    """Orthonormal wavelet filter.

    Parameters
    ----------
    name : str
        Name for `find_filter`, such as "la8".
    scaling : (L,) array
        Scaling coefficients g_l, applied as V_t = Σ_l g_l X_{t−l}.
    vanishing_moments : int
        Number p of vanishing moments. The wavelet filter removes polynomials up to degree p − 1, and therefore a linear
        drift if p ≥ 2.
    accuracy : float
        Largest error of the published coefficients.
    adjustment : float
        Largest change of a published coefficient.
    source : str
        Source of the published coefficients.
    lags : tuple of int
        Lags l of the autocovariances of first differences that a curve has beside its wavelet variances, only with the
        Haar filter. They have the level −l: the moment is the variance of (W_{1,t} + W_{1,t−l})/√2, with wavelet
        coefficients W_1 of level 1. It is the wavelet variance of level 1 plus a quarter of the autocovariance.

    Examples
    --------
    >>> la8 = find_filter("la8")
    >>> la8
    WaveletFilter('la8', length 8, 4 vanishing moments)
    >>> la8.width(3)
    50
    """

    name: str
    scaling: Vector
    vanishing_moments: int
    accuracy: float
    adjustment: float
    source: str
    lags: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        freeze(self.scaling)

    def __reduce_ex__(self, protocol: SupportsIndex) -> str | tuple[Any, ...]:
        """Pickle a filter of the table by its name, because code for the Haar filter tests `filter is HAAR`."""
        if (self.name in _TABLES or self.lags) and find_filter(self.name) is self:
            return find_filter, (self.name,)
        return super().__reduce_ex__(protocol)

    @property
    def length(self) -> int:
        """Number of taps L."""
        return int(self.scaling.size)

    @cached_property
    def wavelet(self) -> Vector:
        """Wavelet coefficients h_l = (−1)^l g_{L−1−l} (L,)."""
        return freeze(self.scaling[::-1] * (-1.0) ** np.arange(self.length))

    @cached_property
    def first_moment(self) -> float:
        """First moment Σ_l l h_l of the orthonormal filter with exact taps; 0 for two or more vanishing moments.

        For fk8, it is 5.8e-5, although its terms are of size 1. Rounded taps change it by 1e-12 of its value, and the
        order of summation adds further errors. Therefore the sum is computed in exact arithmetic, and one Newton step
        corrects the rounding of the taps."""
        if self.vanishing_moments > 1:
            return 0.0
        g = [Fraction(float(tap)) for tap in self.scaling]
        defect = [sum(a * b for a, b in zip(g[2 * k :], g, strict=False)) - (k == 0) for k in range(len(g) // 2)]
        defect.append(sum((-1) ** i * tap for i, tap in enumerate(g)))
        slopes = np.concatenate([_slopes(self.scaling), [(-1.0) ** np.arange(self.length)]])
        step = np.linalg.lstsq(slopes, np.array(defect, dtype=np.float64), rcond=_DEPENDENT)[0]
        taps = [tap - Fraction(float(change)) for tap, change in zip(g, step, strict=True)]
        return float(sum(l * (-1) ** l * tap for l, tap in enumerate(reversed(taps))))  # noqa: E741

    def width(self, level: int) -> int:
        """Return the number of taps of the level-j filter, L_j = (2^j − 1)(L − 1) + 1."""
        return int(self.widths(level))

    def widths(self, levels: ArrayLike) -> NDArray[np.int64]:
        """Return the number of taps L_j of the filters of several levels; l + 2 for the level −l of a lag."""
        numbers = np.asarray(levels, dtype=np.int64)
        taps = ((np.int64(1) << np.maximum(numbers, 1)) - 1) * (self.length - 1) + 1
        return np.where(numbers < 0, 2 - numbers, taps)

    def numbers(self, levels: int | ArrayLike) -> NDArray[np.int64]:
        """Check levels, which may be the negative lags of this filter; a number J means the lags and 1, …, J. A level
        that the lags contain is left out: but for the ends of the signal, ν_j² is a sum of ν_1² and of the moments at
        the lags up to 2^j − 2, and the ends are not normal."""
        if not self.lags:
            return as_levels(levels)
        array = np.asarray(levels)
        if array.ndim == 0:
            scales = as_levels(levels)
            reach = sum(lag == place for place, lag in enumerate(self.lags, 1))  # lags 1, …, reach without a gap
            return np.concatenate([-np.array(self.lags[::-1]), scales[(scales == 1) | ((1 << scales) - 2 > reach)]])
        as_levels(array[array > 0])
        return array.astype(np.int64)

    def deepest_level(self, samples: int) -> int:
        """Return the highest level whose filter fits into a recording of `samples`; 0 if there is none."""
        return ((samples - 1) // (self.length - 1) + 1).bit_length() - 1 if samples > 0 else 0

    def level_filter(self, level: int) -> Vector:
        """Return the taps (L_j,) of the maximal-overlap wavelet filter of one level.

        Raises
        ------
        OptionError
            If there are more than 2^24 taps; `squared_gain` and `autocorrelation` work at any level.

        >>> find_filter("haar").level_filter(2)
        array([ 0.25,  0.25, -0.25, -0.25])
        """
        # Largest number of taps of a filter that `level_filter` returns; 2^24 doubles take 128 MB.
        longest_filter = 2**24
        if not 1 <= level <= 62 or self.width(level) > longest_filter:
            raise OptionError(
                argument="level", expected=f"from 1 to 62, with a filter of at most {longest_filter} taps", got=level
            )
        smooth = np.ones(1)
        for j in range(level):
            filter_ = (self.wavelet if j == level - 1 else self.scaling) / np.sqrt(2.0)
            spread = np.zeros((filter_.size - 1) * 2**j + 1)
            spread[:: 2**j] = filter_
            smooth = _convolve(spread, smooth)
        return smooth

    def squared_gain(self, frequencies: ArrayLike, level: int) -> NDArray[np.float64]:
        """Return the squared gain |H_j(f)|² of the maximal-overlap level-j wavelet filter at frequencies f in cycles
        per sample (the frequency in Hz times the sampling interval).

        The wavelet variance of a process with spectral density S is ∫ |H_j(f)|² S(f) df."""
        f = np.asarray(frequencies, dtype=np.float64)
        gain = np.ones(f.shape)
        for j in range(level):
            filter_ = self.wavelet if j == level - 1 else self.scaling
            angle = 2.0 * np.pi * np.mod(np.ldexp(f, j), 1.0)
            gain *= 0.5 * np.abs(np.polyval(filter_[::-1], np.exp(-1j * angle))) ** 2
        return gain

    def autocorrelation(self, lags: ArrayLike, level: int) -> NDArray[np.float64]:
        """Return the autocorrelation r_j(k) = Σ_l h_{j,l} h_{j,l+k} of the maximal-overlap level-j wavelet filter at
        lags k.

        It is computed from level to level: r_j(k) = Σ_n r_g(n) r_{j−1}((k − n)/2), where r_g is the autocorrelation of
        the scaling filter and n has the parity of k. One lag takes O(j L²) operations, which do not depend on L_j."""
        distances, where = np.unique(np.abs(np.asarray(lags, dtype=np.int64)), return_inverse=True)
        return np.asarray(self._autocorrelation(distances, level)[where].reshape(np.shape(lags)))

    def _autocorrelation(self, lags: NDArray[np.int64], level: int) -> Vector:
        reach = self.length - 1
        # One step of the product filter g(z) g(1/z)/2, whose even coefficients are 0, except for the middle one.
        step = 0.5 * np.correlate(self.scaling, self.scaling, "full")
        if level == 1:
            signed = step * (-1.0) ** np.arange(-reach, reach + 1)
            return np.where(np.abs(lags) <= reach, signed[np.clip(lags + reach, 0, 2 * reach)], 0.0)
        n = np.arange(-reach, reach + 1)
        twice = lags[:, None] - n
        even = twice % 2 == 0
        below, where = np.unique(np.abs(twice[even]) // 2, return_inverse=True)
        values = np.zeros(twice.shape)
        values[even] = self._autocorrelation(below, level - 1)[where]
        return np.asarray(values @ step)

    def __repr__(self) -> str:
        return f"WaveletFilter({self.name!r}, length {self.length}, {self.vanishing_moments} vanishing moments)"


def _convolve(a: Vector, b: Vector) -> Vector:
    if min(a.size, b.size) < 64:
        return np.convolve(a, b)
    from scipy.signal import oaconvolve

    return np.asarray(oaconvolve(a, b), dtype=np.float64)


def find_filter(filter: str | WaveletFilter) -> WaveletFilter:
    """Return the wavelet filter with a name.

    The names are haar, d4 d6 d8 d16, la8 la16 la20, bl14 bl20, fk4 fk8 fk14 fk22 and mb4 mb8 mb16 mb24, and
    "haar + lags:8" or "haar + lags:3,5" with autocovariances of first differences; see `gmwm.fit`. If PyWavelets is
    installed, its orthogonal filters are available too: db1 … db38, sym2 … sym20, coif1 … coif17. PyWavelets numbers
    Daubechies filters by vanishing moments and reverses them in time (db2 is d4 reversed; sym4 is la8), which does not
    change a variance.

    Parameters
    ----------
    filter : str or WaveletFilter
        Name in any case, or a filter, which is returned unchanged.

    Returns
    -------
    WaveletFilter
        The same object for the same name.

    Raises
    ------
    OptionError
        If the name is unknown.
    MissingDependencyError
        If the filter belongs to PyWavelets, which is not installed.

    Examples
    --------
    >>> find_filter("la8").length, find_filter("la8").vanishing_moments
    (8, 4)
    >>> find_filter("mb4").adjustment <= 1e-7
    True
    """
    if isinstance(filter, WaveletFilter):
        return filter
    if not isinstance(filter, str):
        raise OptionError(argument="filter", expected="the name of a wavelet filter, such as haar or la8", got=filter)
    return _find(filter.strip().lower())


@lru_cache(maxsize=256)
def _find(name: str) -> WaveletFilter:
    if name in _TABLES:
        table = _TABLES[name]
        published = np.array(table.scaling.split(), dtype=np.float64)
        return _filter(name, published, moments=table.vanishing_moments, accuracy=table.accuracy, source=table.source)
    if match := re.fullmatch(r"haar\s*\+\s*lags:\s*(\d+(?:\s*,\s*\d+)*)", name):
        return _with_lags(tuple(int(lag) for lag in match[1].split(",")))
    if re.fullmatch(r"(db|sym|coif)[1-9]\d?", name):
        return _from_pywavelets(name)
    raise OptionError(
        argument="filter",
        expected=f"one of {', '.join(FILTERS)}, or of PyWavelets: db1 … db38, sym2 … sym20, coif1 … coif17",
        got=name,
    )


@lru_cache(maxsize=64)
def _with_lags(lags: tuple[int, ...]) -> WaveletFilter:
    """Return the Haar filter with lags; a single number is the largest one."""
    if not all(1 <= lag <= _MOST_LAGS for lag in lags):
        raise OptionError(argument="filter", expected=f"lags from 1 to {_MOST_LAGS}", got=lags)
    every = tuple(sorted(set(lags)))
    if every != lags:
        return _with_lags(every)
    name = f"haar + lags:{','.join(map(str, every))}"
    return replace(HAAR, name=name, lags=every if len(every) > 1 else tuple(range(1, lags[0] + 1)))


def _from_pywavelets(name: str) -> WaveletFilter:
    pywt = library("pywt")
    try:
        wavelet = pywt.Wavelet(name)
    except ValueError as error:
        raise OptionError(f"PyWavelets has no filter {name!r} ({error})", argument="filter", got=name) from error
    published = np.array(wavelet.dec_lo, dtype=np.float64)
    moments, source = int(wavelet.vanishing_moments_psi), f"PyWavelets {pywt.__version__}"
    # PyWavelets' long filters have errors of 2e-13; their correction would change coefficients by 3e-8.
    return _filter(name, published, moments=moments, accuracy=2e-11, source=source, rounding=1024.0)


def _filter(
    name: str, published: Vector, moments: int, accuracy: float, source: str, rounding: float = 8.0
) -> WaveletFilter:
    scaling = project(published, moments, rounding)
    return WaveletFilter(
        name=name, scaling=scaling, vanishing_moments=moments, accuracy=accuracy,
        adjustment=float(np.abs(scaling - published).max()), source=source,
    )  # fmt: skip


def project(scaling: Vector, vanishing_moments: int, rounding: float = 8.0) -> Vector:
    """Return the nearest orthonormal filter with p vanishing moments, by minimum-norm Newton steps on Σ_l g_l g_{l+2k}
    = 1{k = 0} and Σ_l (−1)^l l^n g_l = 0, n < p: a table orthonormal to 1e-11 can have the wavelet sum 1e-5, as fk22.
    An error below `rounding` units in the last place of 1 changes nothing."""
    g = scaling.copy()
    length = g.size
    place = (np.arange(length) - (length - 1) / 2) / (length / 2)
    # Chebyshev polynomials instead of powers, which would be numerically dependent long before p = 38.
    polynomials = np.linalg.qr(np.cos(np.outer(np.arccos(place), np.arange(vanishing_moments))))[0]
    moments = polynomials.T * (-1.0) ** np.arange(length)
    best, least = g, np.inf
    for _ in range(8):
        shifted = [np.concatenate([g[2 * k :], np.zeros(2 * k)]) for k in range(length // 2)]
        defect = np.concatenate([[g @ s for s in shifted], moments @ g])
        defect[0] -= 1.0
        size = float(np.abs(defect).max())
        if size >= least:
            break
        best, least = g, size
        if size <= rounding * np.finfo(float).eps:
            break
        g = g - np.linalg.lstsq(np.concatenate([_slopes(g), moments]), defect, rcond=_DEPENDENT)[0]
    return best


def _slopes(g: Vector) -> Matrix:
    """Return the derivatives (L/2, L) of Σ_l g_l g_{l+2k} with respect to the taps."""
    padded = np.concatenate([np.zeros(g.size), g, np.zeros(g.size)])
    return np.array(
        [padded[g.size + s : 2 * g.size + s] + padded[g.size - s : 2 * g.size - s] for s in range(0, g.size, 2)]
    )


@dataclass(frozen=True)
class _FilterTable:
    source: str
    vanishing_moments: int
    accuracy: float
    scaling: str


_DAUBECHIES = "Daubechies, extremal phase; solved from their defining equations at 40 digits"
_LEAST_ASYMMETRIC = "Daubechies, least asymmetric; solved from their defining equations at 40 digits"
_BEST_LOCALIZED = "best localized: Doroslovacki (1998); table of Percival and Walden (2000), Wavelet Methods"
_FEJER_KOROVKIN = "Fejer-Korovkin: Nielsen (2001), J. Approx. Theory 108, 36-52"
_MINIMUM_BANDWIDTH = "minimum bandwidth: Morris and Peravali (1999), Optical Engineering 38, 1479-1485"

_EXACT = 1e-15

# fmt: off
# Scaling coefficients, vanishing moments, and the accuracy of the published digits. For fk22 and fk4 the accuracy is
# only the square root of the last digit, because the filter comes from a spectrum with a double zero.
_TABLES: dict[str, _FilterTable] = {
    "haar": _FilterTable(_DAUBECHIES, 1, _EXACT, "0.70710678118654752 0.70710678118654752"),
    "d4": _FilterTable(_DAUBECHIES, 2, _EXACT, """
        0.48296291314453414 0.83651630373780791 0.22414386804201338 -0.12940952255126038"""),
    "d6": _FilterTable(_DAUBECHIES, 3, _EXACT, """
        0.33267055295008262 0.80689150931109258 0.45987750211849157 -0.13501102001025459 -0.085441273882026662
        0.035226291885709537"""),
    "d8": _FilterTable(_DAUBECHIES, 4, _EXACT, """
        0.2303778133088965 0.71484657055291565 0.63088076792985891 -0.027983769416859854 -0.18703481171909308
        0.030841381835560764 0.0328830116668852 -0.010597401785069032"""),
    "d16": _FilterTable(_DAUBECHIES, 8, _EXACT, """
        0.05441584224310401 0.31287159091429997 0.67563073629728981 0.58535468365420671 -0.015829105256349306
        -0.28401554296154693 0.00047248457391328277 0.12874742662047846 -0.017369301001807546
        -0.044088253930794752 0.013981027917398282 0.0087460940474057767 -0.0048703529934515743
        -0.00039174037337694705 0.00067544940645056937 -0.00011747678412476953"""),
    "la8": _FilterTable(_LEAST_ASYMMETRIC, 4, _EXACT, """
        -0.075765714789502213 -0.029635527646002492 0.49761866763277499 0.80373875180513208 0.29785779560530605
        -0.099219543576633533 -0.012603967262031304 0.032223100604051468"""),
    "la16": _FilterTable(_LEAST_ASYMMETRIC, 8, _EXACT, """
        -0.0033824159510050026 -0.00054213233180001069 0.031695087811525991 0.0076074873249766082
        -0.14329423835127266 -0.061273359067811078 0.48135965125905339 0.77718575169962803 0.36444189483617894
        -0.051945838107881801 -0.027219029917103486 0.049137179673730287 0.0038087520138944895
        -0.014952258337062199 -0.00030292051472413308 0.0018899503327676892"""),
    "la20": _FilterTable(_LEAST_ASYMMETRIC, 10, _EXACT, """
        0.00077015980911445982 9.5632670722852731e-5 -0.0086412992770221503 -0.0014653825813046105
        0.045927239231091509 0.011609893903711318 -0.15949427888491061 -0.070880535783231572 0.47169066693844291
        0.76951003702109794 0.38382676106707633 -0.035536740473819586 -0.031990056882428114 0.049994972077375156
        0.0057649120335811497 -0.020354939812311111 -0.0008043589320164513 0.0045931735853117919
        5.7036083618495007e-5 -0.00045932942100465204"""),
    "bl14": _FilterTable(_BEST_LOCALIZED, 7, 2e-11, """
        0.0120154192834842 0.0172133762994439 -0.0649080035533744 -0.064131289818917 0.360218460898555
        0.781921593296555 0.483610915693782 -0.0568044768822707 -0.101010920866413 0.0447423494687405
        0.0204642075778225 -0.0181266051311065 -0.0032832978473081 0.0022918339541009"""),
    "bl20": _FilterTable(_BEST_LOCALIZED, 10, 8e-10, """
        0.0008625782242896 0.0007154205305517 -0.0070567640909701 0.0005956827305406 0.0496861265075979
        0.0262403647054251 -0.121552106157816 -0.0150192395413644 0.513709872833405 0.766954836501085
        0.340216013511079 -0.0878787107378667 -0.0670899071680668 0.0338423550064691 -0.0008687519578684
        -0.0230054612862905 -0.0011404297773324 0.0050716491945793 0.0003401492622332 -0.0004101159165852"""),
    "fk4": _FilterTable(_FEJER_KOROVKIN, 1, 2e-9, """
        0.653927555569765 0.753272492839487 0.0531792287790598 -0.0461657148152177"""),
    "fk8": _FilterTable(_FEJER_KOROVKIN, 1, 1e-9, """
        0.3492381118638 0.782683620384065 0.475265135079471 -0.0996833284505732 -0.15997809743403
        0.0431066681065162 0.0425816316775818 -0.0190001788537359"""),
    "fk14": _FilterTable(_FEJER_KOROVKIN, 1, 1e-12, """
        0.260371769291396 0.686891477239599 0.611554653959511 0.0514216541421191 -0.245613928162192
        -0.0485753390858553 0.124282560921513 0.0222267396224631 -0.0639973730391417 -0.00507437254997285
        0.029779711590379 -0.00329747915270872 -0.00927061337444824 0.00351410097043596"""),
    "fk22": _FilterTable(_FEJER_KOROVKIN, 1, 6e-7, """
        0.193896107759957 0.589452190929428 0.670084962942026 0.21562984913477 -0.228028855771577
        -0.164465715268843 0.11154914372207 0.110155264934066 -0.0660845167937792 -0.0718416819231261
        0.0435423676255571 0.0447752121844098 -0.0297428807492741 -0.0259708730890212 0.020284486066678
        0.0129642494110898 -0.0128859905624436 -0.00483843263644019 0.00717380316527169 0.00036128556221949
        -0.00267699163858104 0.000880577368638464"""),
    "mb4": _FilterTable(_MINIMUM_BANDWIDTH, 1, 1e-7, """
        0.4801755 0.8372545 0.2269312 -0.1301477"""),
    "mb8": _FilterTable(_MINIMUM_BANDWIDTH, 1, 1e-7, """
        0.06436345 0.007106015 -0.1108673 0.2947855 0.7351331 0.5725771 0.01847751 -0.1673619"""),
    "mb16": _FilterTable(_MINIMUM_BANDWIDTH, 1, 1e-7, """
        0.005765899 0.009620427 -0.04984698 -0.02483876 0.05474628 -0.01987986 -0.05656657 0.2345342 0.6701646
        0.6349228 0.1188725 -0.2278359 -0.0577657 0.1136116 0.02173677 -0.0130277"""),
    "mb24": _FilterTable(_MINIMUM_BANDWIDTH, 1, 1e-7, """
        5.361301e-05 0.001193006 -0.002062335 -0.01644859 0.01027154 0.1479342 -0.004575448 -0.3622424
        -0.3091111 0.2556731 0.6176385 0.4581101 0.1949147 0.1243531 0.1689456 0.1019512 -0.006559513
        -0.002658282 0.04199576 -0.001482995 -0.004879053 0.0007456041 0.0004745736 -2.132706e-05"""),
}
# fmt: on

FILTERS = tuple(_TABLES)  # names of the filters that need no further library

HAAR = find_filter("haar")  # the Haar filter. Twice its wavelet variance is the Allan variance
