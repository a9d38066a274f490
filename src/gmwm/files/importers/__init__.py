"""Make noise models without a recording, from the numbers of a datasheet or from the files of other programs."""

from gmwm.files.importers.api import Given, given_noise
from gmwm.files.importers.values import Values

__all__ = ["Given", "Values", "given_noise"]
