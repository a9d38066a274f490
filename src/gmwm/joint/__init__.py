"""Analyse several signals together: shared noise, joint models, comparison of recordings, and sensor arrays."""

from gmwm.joint.cross import cross
from gmwm.joint.fusion import fuse
from gmwm.joint.fusion_result import VirtualAxis, VirtualSensor
from gmwm.joint.joint_fit import fit_joint
from gmwm.joint.joint_result import JointFit, SharedTerm
from gmwm.joint.result import CrossCovariance, SharedNoise
from gmwm.joint.same import same
from gmwm.joint.same_model import ParameterRatio, SameParameters
from gmwm.joint.same_result import LevelRatio, SameNoise
from gmwm.joint.state_space import JointContinuousStateSpace, JointStateSpace

__all__ = [
    "CrossCovariance", "JointContinuousStateSpace", "JointFit", "JointStateSpace", "LevelRatio", "ParameterRatio",
    "SameNoise", "SameParameters", "SharedNoise", "SharedTerm", "VirtualAxis", "VirtualSensor", "cross", "fit_joint",
    "fuse", "same",
]  # fmt: skip
