"""Several signals at once: the noise that they share, and whether two have the same noise."""

from gmwm.joint.cross import cross
from gmwm.joint.result import CrossCovariance, SharedNoise
from gmwm.joint.same import same
from gmwm.joint.same_result import LevelRatio, SameNoise

__all__ = ["CrossCovariance", "LevelRatio", "SameNoise", "SharedNoise", "cross", "same"]
