"""The tabulated curve stays within its margins of the exact one: on this the bounds rest."""

import numpy as np
import pytest

from gmwm.fitting.estimation.atoms import grid, shapes, table, unit_curve
from gmwm.theory.filters import HAAR
from gmwm.theory.processes import registry

CURVED = [p for p in registry.values() if p.search(10**6, 100.0)]


@pytest.mark.parametrize("process", CURVED, ids=lambda p: p.name)
@pytest.mark.parametrize("samples", [1_000, 10**6, 10**9])
def test_margins_bound_the_error_of_the_cubics(process, samples):
    rate = 100.0
    levels = np.arange(1, samples.bit_length())
    root = np.diag(2.0 ** (levels * np.linspace(0.5, 1.5, levels.size)))
    family = grid(process, levels, samples, rate, HAAR)
    curve = table(family, root)
    for t in (0.07, 0.21, 0.5, 0.83):
        cells = np.flatnonzero(curve.margins >= 0)
        places = [family.place(c + t) for c in cells]
        exact, _ = unit_curve(
            shapes(process, [(family.branches[b], u) for b, u in places], levels, rate, HAAR),
            np.zeros((1, levels.size)),
            root,
        )
        u = 1 - t
        cubic = u * u * ((1 + 2 * t) * curve.values[cells] + t * curve.slopes[cells]) + t * t * (
            (1 + 2 * u) * curve.values[cells + 1] - u * curve.slopes[cells + 1]
        )
        assert np.all(np.linalg.norm(cubic - exact, axis=1) <= curve.margins[cells])
    assert curve.margins.max() < 1e-7


@pytest.mark.parametrize("process", CURVED, ids=lambda p: p.name)
def test_places_and_positions_are_inverse(process):
    family = grid(process, np.arange(1, 15), 20_000, 100.0, HAAR)
    for position in (0.0, 3.25, family.nodes.size - 1.0):
        branch, u = family.place(position)
        assert family.position(branch, u) == pytest.approx(position, abs=1e-9)
