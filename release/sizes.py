"""Megabytes of the core and of each extra, as `docs/install.md` gives them: `python -m release.sizes`.

Counted are the files of each distribution and of all that it requires on this machine, without the bytecode that
Python writes at installation. An extra counts what the core does not have.
"""

from __future__ import annotations

from importlib.metadata import Distribution, distribution
from pathlib import Path

from packaging.requirements import Requirement

import gmwm

EXTRAS = ("plots", "ros", "hdf5", "wavelets", "dask", "app", "all")


def main() -> None:
    """Print the rows of the table."""
    for extra, megabytes in sizes().items():
        print(f"{extra or 'none':10} {megabytes:4.0f}")


def sizes() -> dict[str, float]:
    """Megabytes of the core (""), of what each extra adds to it, and of all together."""
    core = requirements(Requirement("gmwm"), set())
    megabytes = {"": sum(map(size, core))}
    for extra in EXTRAS:
        names = requirements(Requirement(f"gmwm[{extra}]"), set())
        megabytes[extra] = sum(map(size, names if extra == "all" else names - core))
    return megabytes


def requirements(requirement: Requirement, seen: set[str]) -> set[str]:
    """Names of a distribution and of all distributions that it requires here, with its extras."""
    names = {requirement.name.lower()}
    for text in distribution(requirement.name).requires or ():
        needed = Requirement(text)
        if str(needed) not in seen and applies(needed, requirement.extras):
            names |= requirements(needed, seen | {str(needed)})
    return names


def applies(needed: Requirement, extras: set[str]) -> bool:
    """Whether a requirement applies on this machine, for these extras of the distribution that states it."""
    return needed.marker is None or any(needed.marker.evaluate({"extra": extra}) for extra in ("", *extras))


def size(name: str) -> float:
    """Megabytes of the files of a distribution; of gmwm itself those of its package."""
    installed = distribution(name)
    files = package_files() if name == "gmwm" else distribution_files(installed)
    return sum(file.stat().st_size for file in files if file.suffix != ".pyc" and file.is_file()) / 1e6


def distribution_files(installed: Distribution) -> list[Path]:
    """Return the paths that a distribution has installed."""
    return [Path(str(installed.locate_file(file))) for file in installed.files or ()]


def package_files() -> list[Path]:
    """Return the paths of the package gmwm, which an editable installation does not list."""
    return [file for folder in gmwm.__path__ for file in Path(folder).rglob("*")]


if __name__ == "__main__":
    main()
