"""The conic least-squares problem, against an independent solver and against nonnegative least squares."""

import numpy as np
import pytest

from gmwm.applications.several.conic import Cone, least_squares
from gmwm.applications.several.matrices import entries
from gmwm.base import _core
from tests.helpers import each


def problem(seed, d=None):
    """Shapes of four terms that are nearly collinear, covariance matrices of low rank, and noise."""
    rng = np.random.default_rng(seed)
    d = d or int(rng.integers(2, 7))
    levels = np.arange(1, 13)
    tau = 2.0**levels
    x = 0.01 * tau
    shapes = np.array([1 / tau, (tau**2 + 2) / (12 * tau), *(1 / (1 / x**a + x**a) for a in (0.9, 1.1))])
    full = rng.random(4) < 0.7
    full[rng.integers(4)] = True
    cone = Cone(d, full)
    rank = int(rng.integers(1, d + 1))
    sigmas = np.array([(f := rng.standard_normal((d, rank))) @ f.T if whole else np.diag(rng.random(d))
                       for whole in full])  # fmt: skip
    sigmas *= np.array([1.0, 1e-5, 0.1, 0.1])[:, None, None]
    rows, _ = entries(d)
    whole = np.einsum("pj,im->pijm", shapes, np.eye(rows.size)).transpose(0, 1, 3, 2)
    columns = whole.reshape(4 * rows.size, -1)[cone.free].T
    weights = np.tile(tau**0.5, rows.size) * (1 + 0.2 * rng.random(columns.shape[0]))
    design = weights[:, None] * columns
    target = design @ cone.unknowns(sigmas)
    target += 0.05 * np.linalg.norm(target) / np.sqrt(target.size) * rng.standard_normal(target.size)
    return design, target, cone


def reference(design, target, cone):
    """The objective by Clarabel's interior point method."""
    clarabel = pytest.importorskip("clarabel", reason="needs Clarabel: pip install '.[dev]'")
    from scipy import sparse

    # Half vectorised matrices in the order and scaling of the cone of triangles.
    d, size = cone.d, np.linalg.norm(design, axis=0)
    rows, columns = entries(d)
    place = np.flatnonzero(cone.free)
    blocks, cones = [], []
    for p, full in enumerate(cone.full):
        own = np.zeros((rows.size, design.shape[1]))
        for k, at in enumerate(place):
            if at // rows.size == p:
                own[at % rows.size, k] = -1 / size[k] * np.linalg.norm(target)
        if full:
            order = np.lexsort((rows, columns))
            scale = np.where(rows == columns, 1.0, np.sqrt(2.0))
            blocks.append((own * scale[:, None])[order])
            cones.append(clarabel.PSDTriangleConeT(d))
        else:
            blocks.append(own[rows == columns])
            cones.append(clarabel.NonnegativeConeT(d))
    unit, y = design / size, target / np.linalg.norm(target)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    matrix = sparse.csc_matrix(np.concatenate(blocks))
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(2 * unit.T @ unit)),
        -2 * unit.T @ y,
        matrix,
        np.zeros(matrix.shape[0]),
        cones,
        settings,
    )
    s = np.array(solver.solve().x)
    return float(np.sum((unit @ s - y) ** 2)) * float(target @ target)


@pytest.mark.slow
@each("seed", range(50))
def test_the_optimum_is_that_of_another_solver(seed):
    design, target, cone = problem(seed)
    found = least_squares(design, target, cone, gap=1e-9)
    expected = reference(design, target, cone)
    assert found.objective <= expected * (1 + 1e-7)
    assert found.objective - found.gap <= expected * (1 + 1e-9)
    assert np.linalg.eigvalsh(found.sigmas).min() >= 0


def test_diagonal_terms_are_nonnegative_least_squares():
    design, target, cone = problem(3, d=3)
    cone = Cone(3, np.zeros(4, bool))
    rows, columns = entries(3)
    design = np.random.default_rng(1).standard_normal((40, 12))
    target = np.random.default_rng(2).standard_normal(40)
    found = least_squares(design, target, cone, gap=1e-12)
    length = np.linalg.norm(design, axis=0)
    _, objective = _core.nonnegative_least_squares(target, np.ascontiguousarray((design / length).T))
    assert found.objective == pytest.approx(objective, rel=1e-9)
    assert np.allclose(found.sigmas[:, rows, columns][:, rows != columns], 0)


def test_a_warm_start_leads_to_the_same_optimum():
    design, target, cone = problem(7)
    cold = least_squares(design, target, cone)
    warm = least_squares(design * (1 + 1e-3), target, cone, warm=cold.warm)
    assert warm.objective == pytest.approx(cold.objective, rel=1e-8)
    assert warm.steps < cold.steps


def test_the_scale_of_the_data_does_not_matter():
    design, target, cone = problem(8)
    one = least_squares(design, target, cone)
    for unit in (1e-12, 1e12):
        other = least_squares(design, unit * target, cone)
        assert np.allclose(other.sigmas, unit * one.sigmas, rtol=1e-6, atol=1e-9 * unit * np.abs(one.sigmas).max())
        assert other.objective == pytest.approx(unit**2 * one.objective, rel=1e-9)
