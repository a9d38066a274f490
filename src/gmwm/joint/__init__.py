"""Several signals at once: shared noise, recordings with the same noise, and the best virtual sensor of an array."""

from gmwm.joint.cross import cross
from gmwm.joint.fusion import fuse
from gmwm.joint.fusion_result import VirtualAxis, VirtualSensor
from gmwm.joint.result import CrossCovariance, SharedNoise
from gmwm.joint.same import same
from gmwm.joint.same_result import LevelRatio, SameNoise

__all__ = [
    "CrossCovariance", "LevelRatio", "SameNoise", "SharedNoise", "VirtualAxis", "VirtualSensor", "cross", "fuse",
    "same",
]  # fmt: skip
