"""Test a recording for outliers, and distinguish knocks and wrong samples from heavy-tailed noise."""

from gmwm.measuring.outliers.bursts import MATERIAL, Bursts, find_bursts
from gmwm.measuring.outliers.cleaning import Cleaned, Replaced, Screen, Screening, cleaned, screened
from gmwm.measuring.outliers.ratio_test import (
    TOLERANCE,
    Dependence,
    Verdict,
    contamination,
    dependence,
    excess_text,
    other_efficiency,
)
from gmwm.measuring.outliers.spikes import Spikes, find_spikes, repaired

__all__ = [
    "MATERIAL", "TOLERANCE", "Bursts", "Cleaned", "Dependence", "Replaced", "Screen", "Screening", "Spikes", "Verdict",
    "cleaned", "contamination", "dependence", "excess_text", "find_bursts", "find_spikes", "other_efficiency",
    "repaired", "screened",
]  # fmt: skip
