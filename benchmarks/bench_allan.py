"""The Allan family against allantools, on the same record at octaves, limits and noise types included."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import allantools
import numpy as np

from benchmarks.harness import Case
from gmwm.measuring.variance.allan import allan_variance, hadamard_variance, total_variance


def cases() -> Iterable[Case]:
    """White noise of 10^6 samples, and of 10^7, where the fixed cost of limits and noise types is small."""
    members = (
        ("overlapping Allan", allan_variance, allantools.oadev, 6, 11, None),
        ("overlapping Allan", allan_variance, allantools.oadev, 7, 3, 0.1),
        ("modified Allan", partial(allan_variance, kind="modified"), allantools.mdev, 6, 11, None),
        ("overlapping Hadamard", hadamard_variance, allantools.ohdev, 6, 11, None),
        ("total", total_variance, allantools.totdev, 6, 11, None),
    )
    for name, ours, theirs, digits, repeats, target in members:
        x = np.random.default_rng(1).standard_normal(10**digits)
        reference = partial(theirs, x, rate=100.0, data_type="freq", taus="octave")
        tau, deviation, _, _ = reference()
        run = partial(ours, x, 100.0)
        found = run()
        # Theirs leaves out sizes of few differences; ours, in the total variance, those beyond half the record.
        shared = min(tau.size, len(found))
        np.testing.assert_allclose(found.tau[:shared], tau[:shared])
        np.testing.assert_allclose(found.deviation[:shared], deviation[:shared], rtol=1e-8)
        yield Case(f"{name}, octaves of 10^{digits}", run, "allantools", reference, repeats, target)
