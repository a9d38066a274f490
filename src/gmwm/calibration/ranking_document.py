"""Convert a ranking to a part of calibration.json and back. Data that several fits have in common are stored once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gmwm.base.arrays import Matrix
from gmwm.base.documents import plain_fields
from gmwm.base.errors import ReadError
from gmwm.calibration.options import AGAIN
from gmwm.choosing.selection import Ranking
from gmwm.choosing.selection.ranking import Candidate
from gmwm.fitting.estimation.criterion import Criterion
from gmwm.fitting.estimation.result import Diagnostics, Fit
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.model import Model


def ranking_document(ranking: Ranking) -> dict[str, Any]:
    """Return a ranking as plain values: the result of `Ranking.to_dict`, and the fits of its candidates."""
    fits = {id(fit): fit for fit in (ranking.general, *(candidate.fit for candidate in ranking))}
    place = {key: k for k, key in enumerate(fits)}
    content = ranking.to_dict()
    for candidate, values in zip(ranking, content["candidates"], strict=True):
        values["asked"] = str(candidate.model)  # This text includes fixed values.
        values["fit"] = place[id(candidate.fit)]
    return {
        **content, "fits": [_short(fit) for fit in fits.values()],
        "weighting_matrix": ranking.weighting_matrix.tolist(), "wavelet_covariance": ranking.wavelet.tolist(),
    }  # fmt: skip


def _short(fit: Fit) -> dict[str, Any]:
    """Return what cannot be computed from the wavelet variance and the weighting matrix."""
    return plain_fields(fit, "model objective lower_bound relaxed_bound", finite=False) | fit.diagnostics.to_dict()


def ranking_from(content: Mapping[str, Any], wv: WaveletVariance) -> Ranking:
    """Restore a ranking from the result of `ranking_document` and the wavelet variance of its fits, or raise a
    ReadError."""
    size = len(wv)
    matrix, wavelet = (_square(content[name], size) for name in ("weighting_matrix", "wavelet_covariance"))
    weighting = str(content["weighting"])
    fits = [_fit(values, wv, weighting, matrix) for values in content["fits"]]
    candidates = tuple(_candidate(values, fits[values["fit"]]) for values in content["candidates"])
    if sum(candidate.recommended for candidate in candidates) != 1:
        raise ReadError("not a ranking: one candidate must be recommended", advice=AGAIN)
    return Ranking(
        candidates=candidates, within=Model.parse(content["within"]), general=fits[0], weighting=weighting,
        weighting_matrix=matrix, wavelet=wavelet, confidence=float(content["confidence"]),
    )  # fmt: skip


def _candidate(values: Mapping[str, Any], fit: Fit) -> Candidate:
    wic = values["wic"]
    return Candidate(
        model=Model.parse(values["asked"]), fit=fit,
        wic=Criterion(loss=float(wic["loss"]), optimism=float(wic["optimism"]), method=wic["method"]),
        out_of_sample=values["out_of_sample"], difference=float(values["difference"]),
        parameters=int(values["parameters"]), equivalent=bool(values["equivalent"]),
        recommended=bool(values["recommended"]), same_as=values["same_as"],
    )  # fmt: skip


def _fit(values: Mapping[str, Any], wv: WaveletVariance, weighting: str, matrix: Matrix) -> Fit:
    model = Model.parse(values["model"])
    lower = values["lower_bound"]
    return Fit(
        wavelet_variance=wv, model=model,
        parameters={name: value for name, value in model.parameters.items() if value is not None},
        objective=float(values["objective"]), lower_bound=None if lower is None else float(lower),
        relaxed_bound=float(values["relaxed_bound"]), implied=model.wavelet_variance(wv.levels, wv.rate, wv.filter),
        decomposition=model.decomposition(wv.levels, wv.rate, wv.filter), weighting=weighting, weighting_matrix=matrix,
        diagnostics=Diagnostics.from_dict(values),
    )  # fmt: skip


def _square(values: Any, size: int) -> Matrix:
    matrix = np.array(values, dtype=np.float64)
    if matrix.shape != (size, size):
        raise ReadError(
            f"not a ranking: a matrix has the shape {matrix.shape}, but the data have {size} levels", advice=AGAIN
        )
    return matrix
