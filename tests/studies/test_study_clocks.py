"""Reduced run of validation/study_clocks.py: rate and gaps are right, whatever the clock."""

import numpy as np
import pytest

from gmwm.files.clock import clock
from gmwm.files.clock.clock import clock_of
from validation import study_clocks
from validation.clock_zoo import KINDS

pytestmark = pytest.mark.slow

HARD = ("jitter 0.1 ms, 25 losses", "jitter 0.3 ms, 25 losses")
"""Rounding and jitter together: the study finds 99 % of these gaps, but not all."""


def test_rate_and_gaps_of_every_kind_of_clock():
    result = study_clocks.run(reduced=True)
    assert len(result["rows"]) > 50
    for row in result["rows"]:
        assert row["rate"] < 1e-4, row
        if not row["limit"] and not row["kind"].endswith(HARD):
            assert row["right"] == result["seeds"], row
        else:
            assert row["missed"] + row["length"] + row["invented"] <= 2 + 0.015 * row["gaps"], row
    assert study_clocks.table(result).count("\n| ") == len(result["rows"]) + 2


@pytest.mark.parametrize("name", [name for name in KINDS if not name.startswith(("two rates", "1000.3 Hz"))][::3])
def test_chunks_and_blocks_make_no_difference(name, monkeypatch):
    """Any chunks give the same clock to the last bit, and many blocks the same gaps as one."""
    record = KINDS[name](np.random.default_rng(2))
    chunks = np.split(record.stamps, [1, 2, record.stamps.size // 3, record.stamps.size - 5])
    whole = clock_of([record.stamps], record.unit, record.declared)[0]
    assert clock_of(chunks, record.unit, record.declared)[0] == whole
    monkeypatch.setattr(clock, "BLOCK", 7000)
    monkeypatch.setattr(clock, "MARGIN", 3500)
    blocks = clock_of([record.stamps], record.unit, record.declared)[0]
    assert clock_of(chunks, record.unit, record.declared)[0] == blocks
    assert len(blocks.segments) == len(whole.segments)
    assert blocks.base.rate == pytest.approx(whole.base.rate, rel=2e-4)
