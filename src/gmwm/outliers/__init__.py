"""Outliers in a recording: a test for them, and what tells knocks and wrong samples from noise with heavy tails."""

from gmwm.outliers.bursts import MATERIAL, Bursts, find_bursts
from gmwm.outliers.dependence import Dependence, dependence, other_efficiency
from gmwm.outliers.ratio_test import TOLERANCE, Verdict, contamination, excess_text
from gmwm.outliers.screening import Screen, Screening, screened
from gmwm.outliers.spikes import Spikes, find_spikes, repaired

__all__ = [
    "MATERIAL", "TOLERANCE", "Bursts", "Dependence", "Screen", "Screening", "Spikes", "Verdict", "contamination",
    "dependence", "excess_text", "find_bursts", "find_spikes", "other_efficiency", "repaired", "screened",
]  # fmt: skip
