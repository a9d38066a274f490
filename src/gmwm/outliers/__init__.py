"""Test a recording for outliers, and distinguish knocks and wrong samples from heavy-tailed noise."""

from gmwm.outliers.bursts import MATERIAL, Bursts, find_bursts
from gmwm.outliers.cleaning import Cleaned, cleaned
from gmwm.outliers.dependence import Dependence, dependence, other_efficiency
from gmwm.outliers.ratio_test import TOLERANCE, Verdict, contamination, excess_text
from gmwm.outliers.screening import Replaced, Screen, Screening, screened
from gmwm.outliers.spikes import Spikes, find_spikes, repaired

__all__ = [
    "MATERIAL", "TOLERANCE", "Bursts", "Cleaned", "Dependence", "Replaced", "Screen", "Screening", "Spikes", "Verdict",
    "cleaned", "contamination", "dependence", "excess_text", "find_bursts", "find_spikes", "other_efficiency",
    "repaired", "screened",
]  # fmt: skip
