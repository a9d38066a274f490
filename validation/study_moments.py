"""GMWM+: coverage of intervals, size of the test and errors of fits to wavelet variances and moments at lags.

The series are moving averages of independent errors, Gaussian or Student with 5 degrees of freedom, by SciPy's filter.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

import gmwm

NAME = "moments"
SEED = 20261129
MOMENTS = "haar + lags:8"
MODELS = {"MA(2)": ([], [0.6, 0.3]), "ARMA(2,1)": ([0.9, -0.3], [0.5])}
"""Coefficients φ and θ of the models; the errors have variance 1."""
CASES = (
    ("MA(2)", 2000, None, 300), ("ARMA(2,1)", 2000, None, 300), ("ARMA(2,1)", 2000, 5.0, 300),
    ("ARMA(2,1)", 8000, 5.0, 30), ("ARMA(2,1)", 10_000, None, 100),
)  # fmt: skip
"""Model, samples, degrees of freedom of Student errors (None for Gaussian errors), and series."""

Array = NDArray[np.float64]


def series(rng: np.random.Generator, model: str, samples: int, freedom: float | None) -> Array:
    """A stationary series with errors of variance 1."""
    phi, theta = MODELS[model]
    size = samples + 500
    errors = rng.normal(size=size) if freedom is None else rng.standard_t(freedom, size) * np.sqrt(1 - 2 / freedom)
    return np.asarray(lfilter([1.0, *theta], [1.0, *(-c for c in phi)], errors)[500:])


def bounds(model: str, samples: int) -> Array:
    """Standard errors of Gaussian maximum likelihood, from N/2 ∫ ∂log S ∂log S."""
    phi, theta = MODELS[model]
    z = np.exp(-2j * np.pi * np.arange(4096) / 4096)
    slopes = []
    for coefficients, sign in ((phi, -1.0), (theta, 1.0)):
        polynomial = 1 + sign * sum(c * z ** (k + 1) for k, c in enumerate(coefficients))
        slopes += [2 * np.real(z ** (k + 1) / polynomial) for k in range(len(coefficients))]
    every = np.array([*slopes, np.ones(z.size)])
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(samples / 2 * every @ every.T / z.size))))


def run(reduced: bool = False) -> dict[str, Any]:
    """Coverage, rejections and errors for each kind of series."""
    rows = []
    for place, (model, samples, freedom, series_count) in enumerate(CASES):
        runs = 2 if reduced else series_count
        phi, theta = MODELS[model]
        truth = {f"{model}.phi{k}": c for k, c in enumerate(phi, 1)}
        truth |= {f"{model}.theta{k}": c for k, c in enumerate(theta, 1)} | {f"{model}.sigma2": 1.0}
        covered, values, rejected, widened = [], [], [], []
        for k in range(runs):
            x = series(np.random.default_rng([SEED, place, k]), model, samples, freedom)
            fit = gmwm.fit(model, x, moments=MOMENTS, certify=False)
            limits = fit.confidence_intervals()
            covered.append([limits[key][0] <= true <= limits[key][1] for key, true in truth.items()])
            values.append([fit.parameters[key] for key in truth])
            rejected.append(fit.goodness_of_fit().pvalue < 0.05)
            widened.append(fit.wavelet_variance.excess is not None)
        error = np.sqrt(np.mean((np.array(values) - list(truth.values())) ** 2, axis=0)) / bounds(model, samples)
        rows.append({
            "model": model, "samples": samples, "freedom": freedom, "runs": runs, "parameters": list(truth),
            "covered": np.mean(covered, axis=0).tolist(), "error": error.tolist(),
            "rejected": float(np.mean(rejected)), "widened": float(np.mean(widened)),
        })  # fmt: skip
    return {"rows": rows}


def _errors(freedom: float | None) -> str:
    return "Gaussian" if freedom is None else f"t({freedom:g})"


def table(result: dict[str, Any]) -> str:
    """Markdown: a line for each kind of series."""
    rows = result["rows"]
    gaussian = [row for row in rows if row["freedom"] is None]
    student = [row for row in rows if row["freedom"] is not None]

    def lowest(group: list[dict[str, Any]]) -> str:
        return f"{min(min(row['covered']) for row in group):.0%}"

    def rejections(group: list[dict[str, Any]]) -> str:
        shares = [row["rejected"] for row in group]
        return f"{min(shares):.1%} to {max(shares):.1%}"

    total = sum(row["runs"] for row in rows)
    lines = [
        f'`gmwm.fit(model, x, moments="{MOMENTS}")` was applied to {total} series. 95 % intervals contain the true '
        f"value in {lowest(gaussian)} of them or more with Gaussian errors, and in {lowest(student)} or more "
        f"with errors of heavy tails, which gmwm finds in {min(row['widened'] for row in student):.0%} to "
        f"{max(row['widened'] for row in student):.0%}. At the 5 % level, the goodness-of-fit test rejects "
        f"{rejections(gaussian)} of the true models with Gaussian errors, and {rejections(student)} with heavy tails.",
        "",
        f"![Coverage of the intervals of each parameter]({NAME}.svg)",
        "",
        "| model | samples | errors | runs | intervals with the true value | error / maximum likelihood | rejected | "
        "heavy tails found |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row['model']} | {row['samples']} | {_errors(row['freedom'])} | {row['runs']} | "
            f"{', '.join(f'{share:.0%}' for share in row['covered'])} | "
            f"{', '.join(f'{error:.2f}' for error in row['error'])} | {row['rejected']:.1%} | {row['widened']:.0%} |"
        )
    return "\n".join(lines)


def draw(result: dict[str, Any], path: Path) -> None:
    """Coverage of each parameter with twice its standard error, beside 95 %."""
    from validation.pages import draw_coverage

    bars = []
    for row in result["rows"]:
        kind = f"{row['samples']} samples, {_errors(row['freedom'])}"
        bars += [
            (f"{key}, {kind}", share, row["runs"]) for key, share in zip(row["parameters"], row["covered"], strict=True)
        ]
    draw_coverage(bars, path)
