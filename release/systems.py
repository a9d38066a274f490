"""Run the tests with each compiler, processor and Python that is installed here: `python -m release.systems`.

Without names every system runs whose programs are found, and the others are listed as missing. A system that is named
must be there. What each prints goes into `build/systems/NAME.log`, and the last table into `build/systems/summary.txt`.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import IO

ROOT = Path(__file__).resolve().parent.parent
OUTPUT = ROOT / "build" / "systems"
PYTHON_TESTS = ("-m", "pytest", "-q", "-m", "not (slow or docs or cluster or browser)")
"""The same tests as `make quick`."""
ZIG = (sys.executable, "-m", "ziglang", "c++")
ARM_LIBRARIES = "/usr/aarch64-linux-gnu"
"""Where Debian and Ubuntu keep the libraries of their cross compiler."""
EMSCRIPTEN_TOOLCHAINS = (
    "/usr/share/emscripten/cmake/Modules/Platform/Emscripten.cmake",
    os.environ.get("EMSDK", "") + "/upstream/emscripten/cmake/Modules/Platform/Emscripten.cmake",
)


@dataclass(frozen=True, kw_only=True)
class System:
    """A way to build and run the tests."""

    name: str
    needs: tuple[str, ...]
    """Programs on the path, files (with a slash), and Python modules (with a leading `-m`)."""
    compiler: tuple[str, ...] = ()
    """The C++ compiler with its flags; without one, `needs[0]` is a Python that runs the fast Python tests."""
    settings: tuple[str, ...] = ()
    """More settings of CMake."""
    runs: bool = True
    """Whether this machine can run the programs. Otherwise the kernels are only compiled."""
    libraries: tuple[str, ...] = ()
    """Libraries of the compiler for Python, which then calls the compiled module with hostile arguments."""

    def missing(self) -> list[str]:
        """What is needed and not here."""
        return [need for need in self.needs if not _is_here(need)]

    def commands(self) -> list[list[str]]:
        """What is run, in order; the first prints the version."""
        version = [*(self.compiler or self.needs[:1]), "--version"]
        return [version, *(self._cpp_commands() if self.compiler else self._python_commands())]

    def _cpp_commands(self) -> list[list[str]]:
        folder = str(OUTPUT / self.name)
        parts = ("GMWM_PYTHON=ON", f"Python_EXECUTABLE={sys.executable}") if self.libraries else ("GMWM_TESTS=ON",)
        settings = ("GMWM_PYTHON=OFF", *parts, "CMAKE_BUILD_TYPE=Release", *self.settings)
        if not any(setting.startswith("CMAKE_TOOLCHAIN_FILE=") for setting in settings):
            settings = (f"CMAKE_CXX_COMPILER={';'.join(self.compiler)}", *settings)
        cmake, ctest = _tool("cmake"), _tool("ctest")
        build = [
            [cmake, "-S", str(ROOT), "-B", folder, *(f"-D{setting}" for setting in settings), "--log-level=WARNING"],
            [cmake, "--build", folder, "--parallel", "2"],
        ]
        if self.libraries:
            paths = " ".join(_library(*self.compiler, name) for name in self.libraries)
            # Python keeps memory until its end, and a request for more memory than there is must fail as elsewhere.
            checks = (f"LD_PRELOAD={paths}", "ASAN_OPTIONS=detect_leaks=0:max_allocation_size_mb=4000")
            return [*build, ["env", *checks, sys.executable, "-m", "tests.fuzz.kernels", "--module", folder]]
        if not self.runs:
            return [build[0], [*build[1], "--target", "gmwm_kernels"]]
        return [*build, [ctest, "--test-dir", folder, "--output-on-failure", "--no-tests=error"]]

    def _python_commands(self) -> list[list[str]]:
        folder = OUTPUT / self.name
        python = str(folder / "bin" / "python")
        pip = [python, "-m", "pip", "--disable-pip-version-check", "--quiet", "install"]
        return [
            [self.needs[0], "-m", "venv", str(folder)],
            [*pip, f"--config-settings=build-dir={folder}/build", "--editable", f"{ROOT}[dev]"],
            [python, *PYTHON_TESTS],
        ]


def _is_here(need: str) -> bool:
    if need.startswith("-m "):
        return find_spec(need.removeprefix("-m ")) is not None
    if "/" in need:
        return Path(need).exists()
    # A program on the path may only say that there is none, as those of pyenv do.
    return shutil.which(need) is not None and subprocess.run([need, "--version"], capture_output=True).returncode == 0


def _library(compiler: str, name: str) -> str:
    """Return the path of a library of a compiler, or its name without the compiler."""
    command = [compiler, f"-print-file-name={name}"]
    return subprocess.run(command, capture_output=True, text=True).stdout.strip() if _is_here(compiler) else name


def _tool(name: str) -> str:
    """The program beside this Python, or else the one on the path."""
    beside = Path(sys.executable).with_name(name)
    return str(beside) if beside.exists() else name


# --- the systems --------------------------------------------------------------------------------------


def _native(compiler: str) -> System:
    return System(name=compiler, needs=(compiler,), compiler=(compiler,))


def _sanitized(kind: str, flag: str, compiler: str) -> System:
    # Versions of functions for wider instructions are chosen before the sanitizers have started, so there are none.
    flags = f"-fsanitize={flag} -fno-sanitize-recover=all -D_GLIBCXX_ASSERTIONS -DGMWM_PORTABLE"
    # Clang takes minutes for a file of the Kalman filter that is both checked everywhere and optimised.
    settings = ("CMAKE_BUILD_TYPE=Debug", "CMAKE_CXX_FLAGS_DEBUG=-O1 -g", f"CMAKE_CXX_FLAGS={flags}")
    return System(name=f"{kind}-{compiler}", needs=(compiler,), compiler=(compiler,), settings=settings)


def _hostile(compiler: str) -> System:
    """Return the compiled module with sanitizers, whose functions `tests.fuzz.kernels` calls."""
    sanitized = _sanitized("module", "address,undefined,float-cast-overflow", compiler)
    return replace(sanitized, libraries=("libasan.so", "libstdc++.so"))


def _arm() -> System:
    compiler, emulator = "aarch64-linux-gnu-g++", "qemu-aarch64-static"
    settings = (
        "CMAKE_SYSTEM_NAME=Linux",
        "CMAKE_SYSTEM_PROCESSOR=aarch64",
        f"CMAKE_CROSSCOMPILING_EMULATOR={emulator};-L;{ARM_LIBRARIES}",
    )
    return System(name="aarch64", needs=(compiler, emulator, ARM_LIBRARIES), compiler=(compiler,), settings=settings)


def _windows() -> System:
    compiler = "x86_64-w64-mingw32-g++-posix"
    settings = (
        "CMAKE_SYSTEM_NAME=Windows",
        "CMAKE_SYSTEM_PROCESSOR=AMD64",
        "CMAKE_CROSSCOMPILING_EMULATOR=wine",
        "CMAKE_EXE_LINKER_FLAGS=-static",
    )
    return System(name="mingw", needs=(compiler, "wine"), compiler=(compiler,), settings=settings)


def _mac() -> System:
    # There is no emulator of macOS, so the kernels are only compiled.
    settings = ("CMAKE_SYSTEM_NAME=Darwin", "CMAKE_SYSTEM_PROCESSOR=arm64", "CMAKE_OSX_SYSROOT=")
    return System(
        name="macos-arm64", needs=("-m ziglang",), compiler=(*ZIG, "-target", "aarch64-macos"), settings=settings,
        runs=False,
    )  # fmt: skip


def _emscripten() -> System:
    toolchain = next((file for file in EMSCRIPTEN_TOOLCHAINS if Path(file).exists()), EMSCRIPTEN_TOOLCHAINS[0])
    settings = (
        f"CMAKE_TOOLCHAIN_FILE={toolchain}",
        # One check runs on two threads, and a page must say beforehand how many it may start.
        "CMAKE_CXX_FLAGS=-pthread",
        # In one file, as an old emscripten fetches a second one in a way that new versions of Node refuse.
        "CMAKE_EXE_LINKER_FLAGS=-sSINGLE_FILE -sPTHREAD_POOL_SIZE=2 -sEXIT_RUNTIME -sINITIAL_MEMORY=512MB",
    )
    return System(name="emscripten", needs=("em++", "node", toolchain), compiler=("em++",), settings=settings)


SYSTEMS = (
    *(_native(f"g++-{version}") for version in (11, 12, 13, 14, 15)),
    *(_native(name) for name in ("clang++", "clang++-16", "clang++-18", "clang++-19", "clang++-20")),
    # Clang with the libraries libc++ and, on musl, no glibc.
    System(name="libc++", needs=("-m ziglang",), compiler=ZIG),
    System(name="musl", needs=("-m ziglang",), compiler=(*ZIG, "-target", "x86_64-linux-musl")),
    _arm(),
    _windows(),
    _mac(),
    _emscripten(),
    *(_sanitized("addresses", "address,undefined", compiler) for compiler in ("g++", "clang++")),
    *(_sanitized("threads", "thread", compiler) for compiler in ("g++", "clang++")),
    _hostile("g++"),
    *(System(name=f"python3.{minor}", needs=(f"python3.{minor}",)) for minor in (10, 11, 12, 13, 14)),
)


# --- running ------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Run:
    """What became of one system."""

    name: str
    passed: bool
    detail: str


def run(system: System) -> Run:
    """Build and test; stop at the first command that fails."""
    missing = system.missing()
    if missing:
        return Run(name=system.name, passed=False, detail=f"missing: {', '.join(missing)}")
    OUTPUT.mkdir(parents=True, exist_ok=True)
    start = time.monotonic()
    with (OUTPUT / f"{system.name}.log").open("w+", encoding="utf-8") as log:
        passed = all(_succeeds(command, log) for command in system.commands())
        seconds = time.monotonic() - start
        log.seek(0)
        printed = log.read()
    count, version = counted(printed) if system.runs else "compiled, not run", printed.split("\n", 2)[1]
    detail = f"{count or 'no test ran'}; {seconds:.0f} s; {version}"
    return Run(name=system.name, passed=passed and count is not None, detail=detail)


def _succeeds(command: Sequence[str], log: IO[str]) -> bool:
    print("$", *command, file=log, flush=True)
    # Debian and Ubuntu keep what emscripten loads where only their own Node looks for it.
    environment = {**os.environ, "NODE_PATH": "/usr/share/nodejs"}
    return subprocess.run(command, cwd=ROOT, env=environment, stdout=log, stderr=subprocess.STDOUT).returncode == 0


def counted(log: str) -> str | None:
    """The last line of ctest or pytest that says how many tests passed; None if there is none."""
    found = re.findall(
        r"^\d+% tests passed.* out of \d+$|^.*\b\d+ (?:passed|failed)\b.* in [\d.]+s.*$", log, re.MULTILINE
    )
    return found[-1].strip("= ") if found else None


def chosen(names: Iterable[str]) -> list[System]:
    """The systems with these names; without names, all."""
    by_name = {system.name: system for system in SYSTEMS}
    names = list(names) or list(by_name)
    unknown = [name for name in names if name not in by_name]
    if unknown:
        raise SystemExit(f"unknown systems: {', '.join(unknown)}; known: {', '.join(by_name)}")
    return [by_name[name] for name in names]


def main(arguments: list[str] | None = None) -> int:
    """Run the systems, show their logs where they fail, and list the outcome."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="a system that must be there")
    options = parser.parse_args(arguments)
    lines, failed = [], False
    for system in chosen(options.names):
        done = run(system)
        skipped = bool(system.missing()) and not options.names
        failed |= not (done.passed or skipped)
        lines.append(f"{system.name:<18} {'passed' if done.passed else '-' if skipped else 'FAILED':<7} {done.detail}")
        print(lines[-1], flush=True)
        if not (done.passed or system.missing()):
            print((OUTPUT / f"{system.name}.log").read_text(encoding="utf-8")[-8000:], flush=True)
    OUTPUT.mkdir(parents=True, exist_ok=True)
    (OUTPUT / "summary.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
