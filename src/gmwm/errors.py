"""Every error and warning the package raises, each saying what it means for the answer.

An error message names the argument, what was expected, what came, and the way out.
"""


class GmwmError(Exception):
    """Base of all errors raised on purpose; the command line prints it in one line and exits with 2."""


class DataError(GmwmError, ValueError):
    """The numbers cannot be used: NaN, infinite, constant, too short, with gaps, or of the wrong shape."""


class ReadError(GmwmError, ValueError):
    """The file cannot be read as an inertial recording: foreign, truncated, ragged, or not understood."""


class UnitError(ReadError):
    """A unit is unknown, missing, or contradicts the data."""


class ModelError(GmwmError, ValueError):
    """The model cannot be built or cannot be estimated: wrong parameter, repeated term, too many parameters."""


class OptionError(GmwmError, ValueError):
    """An argument is not one of the values it may take."""


class MissingTheoryError(ModelError):
    """A process was asked for theory that it does not have (a drift has no spectral density)."""


class MissingDependencyError(GmwmError, ImportError):
    """An optional library is not installed; the message names the extra that brings it."""


class GmwmWarning(UserWarning):
    """Base of all warnings: the answer stands, but read what it says before you use it."""


class InferredUnitWarning(GmwmWarning):
    """A unit was inferred from the data, not declared: if the inference is wrong, every number is off by a factor."""


class TimeBaseWarning(GmwmWarning):
    """The time stamps are irregular (jitter, duplicates, backward steps): the rate is the median's."""


class FitWarning(GmwmWarning):
    """A fitted term is not supported by the data, or acts as another process: read `fit.diagnostics`."""
