"""Libraries that the extras of gmwm install, such as Matplotlib, and what other packages add by entry points."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from typing import Any, NamedTuple

from gmwm.base.errors import GmwmWarning, MissingDependencyError
from gmwm.base.remarks import Remark
from gmwm.base.reporting import warn


class Library(NamedTuple):
    """Name of a library, the extra that installs it, and what needs it."""

    name: str
    extra: str
    purpose: str


LIBRARIES = {
    "dash": Library("Dash", "app", "gmwm app needs"),
    "distributed": Library("Dask", "dask", "several processes or machines need"),
    "h5py": Library("h5py", "hdf5", "HDF5 files need"),
    "lz4.frame": Library("lz4", "ros", "recordings of ROS need"),
    "matplotlib": Library("Matplotlib", "plots", "plots need"),
    "pywt": Library("PyWavelets", "wavelets", "filters of PyWavelets need"),
    "rosbags": Library("rosbags", "ros", "recordings of ROS need"),
}
"""Libraries by the module to import; tests/test_extras.py compares the extras with pyproject.toml."""


def is_installed(module: str) -> bool:
    """Return whether a library of `LIBRARIES` is installed, without importing it."""
    return find_spec(module.partition(".")[0]) is not None


def library(module: str) -> Any:
    """Import a library of `LIBRARIES`. Raises MissingDependencyError with the command that installs it."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != module.partition(".")[0]:
            raise  # the library is damaged: a module that it imports is missing
        raise missing(module) from error


def missing(module: str) -> MissingDependencyError:
    """Return the error that names a library which is not installed, and the extra that installs it."""
    name, extra, purpose = LIBRARIES[module]
    return MissingDependencyError(
        f"{purpose} {name}, which is not installed", advice=f'Install it: `pip install "gmwm[{extra}]"`.'
    )


@cache
def admit_guests(group: str, admit: Callable[[str, Any], object]) -> None:
    """Pass each entry point of a group, such as "gmwm.readers", to a registry, once and late (for unknown names, or
    lists), as the search takes 10 ms and more. `admit` may raise any error."""
    for point in entry_points(group=group):
        try:
            admit(point.name, point.load())
        except Exception as error:  # code of other packages can raise any error
            package = point.dist.name if point.dist is not None else point.value
            reason = f"{type(error).__name__}: {error}"
            remark = Remark.of("guest-unusable", name=point.name, group=group, package=package, reason=reason)
            warn(GmwmWarning(remark), stacklevel=2)
