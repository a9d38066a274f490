"""Analyse several signals together: shared noise, joint models, comparison of recordings, and sensor arrays."""

from gmwm.applications.several.cross import cross
from gmwm.applications.several.fusion import fuse
from gmwm.applications.several.fusion_result import VirtualAxis, VirtualSensor
from gmwm.applications.several.joint_fit import JointFit, SharedTerm, fit_joint
from gmwm.applications.several.result import CrossCovariance, SharedNoise
from gmwm.applications.several.same import ParameterRatio, SameNoise, SameParameters, same
from gmwm.applications.several.state_space import JointContinuousStateSpace, JointStateSpace
from gmwm.choosing.replicates.comparison import LevelRatio

__all__ = [
    "CrossCovariance", "JointContinuousStateSpace", "JointFit", "JointStateSpace", "LevelRatio", "ParameterRatio",
    "SameNoise", "SameParameters", "SharedNoise", "SharedTerm", "VirtualAxis", "VirtualSensor", "cross", "fit_joint",
    "fuse", "same",
]  # fmt: skip
