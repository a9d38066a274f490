"""Call every function of the compiled module with hostile arguments: each call must return, or raise one error.

    python -m tests.fuzz.kernels --calls 20000 --seed 1

Arguments follow from the seed and the number of the call. A call that ends or hangs the process is reported with both.
`--module FILE` calls a module that was built elsewhere, such as with the sanitizers of `make sanitize`.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import pickle
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.arguments import Calls

RECORDED = Path("build") / "fuzz" / "arguments.pickle"
SIZES = (0, 1, 2, 3, 4, 5, 8, 16, 17, 33, 64, 65, 257)
WHOLE = (
    0, 1, 2, 3, 4, 5, 7, 8, 16, 31, 32, 33, 62, 63, 64, 100, 1000, -1, 2**31 - 1, 2**31, 2**32, 2**61, 2**62, 2**63 - 1,
    2**63, 2**64 - 1,
)  # fmt: skip
NUMBERS = (0.0, 1.0, -1.0, 0.5, 1e-320, 1e-160, 1e160, 1e308, -1e308, float("nan"), float("inf"), 0.99999999, 2.0, 1e-3)
LONGEST = 20
"""Processor time (s) after which a call hangs."""
NO_MEMORY = ("allocation-size-too-big", "out-of-memory", "calloc-overflow")
"""Names of the address sanitizer for a request of memory that is refused: a MemoryError without it."""
MEMORY = 4 << 30
"""Largest address space of the process (bytes), without sanitizers."""
REFUSALS = (ValueError, TypeError, MemoryError, OverflowError, IndexError, RuntimeError)


class Arguments:
    """Hostile arguments for the types in the signature of a function."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        # Few sizes, so that arrays often fit each other and the checks of their sizes are passed.
        self.sizes = [int(size) for size in rng.choice(SIZES, 2)]
        self.kind = int(rng.integers(4))

    def size(self) -> int:
        """Return the length of a dimension."""
        return int(self.rng.choice(SIZES)) if self.rng.random() < 0.1 else self.sizes[int(self.rng.integers(2))]

    def of(self, kind: str) -> Any:
        """Return an argument of a type, as the signature writes it."""
        kind = kind.strip()
        if kind.startswith(("ndarray", "numpy.ndarray")):
            return self.array(kind)
        if kind.startswith("tuple["):
            return tuple(self.of(part) for part in split(kind[6:-1]))
        if "Sequence[" in kind or kind.startswith("list["):
            inner = kind[kind.index("[") + 1 : -1]
            count = 5 if inner == "int" else int(self.rng.integers(4))
            return [min(self.of(inner), 2**62) if inner == "int" and self.rng.random() < 0.9 else self.of(inner)
                    for _ in range(count)]  # fmt: skip
        if "bool" in kind:
            return bool(self.rng.integers(2))
        if kind == "int":
            return int(self.rng.integers(6)) if self.rng.random() < 0.6 else WHOLE[int(self.rng.integers(len(WHOLE)))]
        if kind == "float":
            return NUMBERS[int(self.rng.integers(len(NUMBERS)))]
        return self.rng.normal(size=self.size()) if "object" in kind else None

    def array(self, kind: str) -> Any:
        """Return an array: usual values, or some hostile ones among them."""
        dimensions = kind[kind.index("shape=(") :].split(")")[0].count("*")
        shape = [min(self.size(), 17) if dimensions > 2 else self.size() for _ in range(dimensions)]
        if "int64" in kind:
            values = self.rng.integers(0, 12, shape)
            values = np.sort(values.ravel()).reshape(shape) if self.rng.random() < 0.7 else values
            if self.rng.random() < 0.3 and values.size:
                extreme = [-1, 62, 63, 64, 2**31, 2**62, 2**63 - 1, -(2**63)][int(self.rng.integers(8))]
                values.flat[int(self.rng.integers(values.size))] = extreme
            return np.ascontiguousarray(values, dtype=np.int64)
        numbers = self.rng.normal(size=shape)
        numbers = (
            np.abs(numbers) if self.kind == 1 else np.sort(np.abs(numbers), axis=-1) if self.kind == 2 else numbers
        )
        if self.rng.random() < 0.3 and numbers.size:
            numbers.flat[int(self.rng.integers(numbers.size))] = NUMBERS[int(self.rng.integers(len(NUMBERS)))]
        return np.ascontiguousarray(numbers)


def split(text: str) -> list[str]:
    """Divide a text at the commas outside brackets."""
    parts, depth, part = [], 0, ""
    for character in text:
        depth += (character in "[(") - (character in "])")
        if character == "," and depth == 0:
            parts.append(part)
            part = ""
        else:
            part += character
    return [*parts, part] if part.strip() else parts


def parameters(doc: str) -> list[str]:
    """Return the types of the arguments in a signature, without self."""
    inside = doc[doc.index("(") + 1 : doc.rindex(") ->")]
    inside = inside.removesuffix(", /")
    return [part.partition(":")[2].partition(" = ")[0] for part in split(inside) if ":" in part]


def surface(file: str) -> dict[str, tuple[Any, list[str], Any]]:
    """Return the functions and methods of the module with the types of their arguments, and the class of a method."""
    if file:
        spec = importlib.util.spec_from_file_location("_core", file)
        assert spec is not None
        assert spec.loader is not None
        _core = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(_core)
    else:
        from gmwm.base import _core
    found: dict[str, tuple[Any, list[str], Any]] = {}
    for name in sorted(vars(_core)):
        value = getattr(_core, name)
        if name.startswith("_") or not callable(value):
            continue
        if not isinstance(value, type):
            found[name] = value, parameters(value.__doc__ or ""), None
            continue
        for method in sorted(vars(value)):
            member = getattr(value, method)
            doc = str(getattr(member, "__doc__", "") or "").splitlines()
            if (
                callable(member)
                and doc
                and re.match(rf"{method}\(", doc[0])
                and method in ("__init__", *(key for key in vars(value) if not key.startswith("_")))
            ):
                found[f"{name}.{method}"] = value if method == "__init__" else member, parameters(doc[0]), value
    return found


def changed(arguments: Arguments, values: tuple[Any, ...], kinds: list[str]) -> list[Any]:
    """Return good arguments with up to two changes: another value, or one number of an array, or another length."""
    new, rng = list(values), arguments.rng
    for at in rng.integers(0, max(len(new), 1), int(rng.integers(3))).tolist() if new else ():
        old = new[at]
        if isinstance(old, np.ndarray) and old.size and rng.random() < 0.7:
            array = np.array(old)
            if rng.random() < 0.5:
                extreme = WHOLE[:-3] if array.dtype.kind == "i" else NUMBERS
                array.flat[int(rng.integers(array.size))] = extreme[int(rng.integers(len(extreme)))]
            else:
                array = array[: int(rng.integers(len(array) + 1))]
            new[at] = np.ascontiguousarray(array)
        else:
            new[at] = arguments.of(kinds[at])
    return new


def call(number: int, seed: int, functions: dict[str, tuple[Any, list[str], Any]], recorded: Calls) -> str:
    """Make one call; return its outcome. Three of four calls begin with arguments of a calibration."""
    rng = np.random.default_rng([seed, number])
    names = list(functions)
    name = names[number % len(names)]
    function, kinds, owner = functions[name]
    arguments = Arguments(rng)

    def apply(function: Any, name: str, kinds: list[str], *, hostile: bool) -> Any:
        calls = recorded.get(name, [])
        if not calls or rng.random() < 0.25:
            return function(*(arguments.of(kind) for kind in kinds))
        values, count, labels = calls[int(rng.integers(len(calls)))]
        new = changed(arguments, values, kinds) if hostile and len(values) <= len(kinds) else list(values)
        new = [np.array(value) if isinstance(value, np.ndarray) else value for value in new]
        return function(*new[:count], **dict(zip(labels, new[count:], strict=True)))

    try:
        if owner is not None and not name.endswith("__init__"):
            create = f"{owner.__name__}.__init__"
            made = apply(owner, create, functions[create][1], hostile=False)
            function = function.__get__(made) if hasattr(function, "__get__") else function
        apply(function, name, kinds, hostile=True)
    except REFUSALS as error:
        return type(error).__name__
    return "answer"


def child(first: int, last: int, seed: int, file: str) -> None:
    """Make calls, and write the number of each before it begins."""
    if not file:  # the sanitizer of addresses reserves terabytes
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    functions = surface(file)
    recorded = pickle.loads(RECORDED.read_bytes())
    with np.errstate(all="ignore"):
        for number in range(first, last):
            # Ends the process, because a kernel does not handle signals.
            signal.setitimer(signal.ITIMER_PROF, LONGEST)
            sys.stdout.write(f"{number}\n")
            sys.stdout.flush()
            sys.stdout.write(f"{number} {call(number, seed, functions, recorded)}\n")
            signal.setitimer(signal.ITIMER_PROF, 0)


def main() -> int:
    """Make the calls in processes of their own, and print what failed; return 1 if any call did."""
    parser = argparse.ArgumentParser(description="Call every kernel with hostile arguments.")
    parser.add_argument("--calls", type=int, default=6000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--child", type=int, default=0)
    parser.add_argument("--module", default="", help="another build of the compiled module, or its folder")
    given = parser.parse_args()
    if Path(given.module).is_dir() and given.module:
        given.module = str(next(Path(given.module).glob("_core*.so")))
    if given.child:
        child(given.first, given.child, given.seed, given.module)
        return 0
    first, outcomes, failures = given.first, dict[str, int](), 0
    RECORDED.parent.mkdir(parents=True, exist_ok=True)
    if not RECORDED.exists():
        environment = {name: value for name, value in os.environ.items() if name != "LD_PRELOAD"}
        subprocess.run([sys.executable, "-m", "tests.fuzz.arguments", str(RECORDED)], check=True, env=environment)
    names, begin = list(surface(given.module)), time.monotonic()
    while first < given.calls:
        command = [sys.executable, "-m", "tests.fuzz.kernels", "--child", str(given.calls), "--first", str(first)]
        command += ["--seed", str(given.seed), "--module", given.module]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        last = first
        for line in run.stdout.splitlines():
            last, _, outcome = int(line.split()[0]), *line.partition(" ")[1:]
            if outcome:
                outcomes[outcome] = outcomes.get(outcome, 0) + 1
        if run.returncode == 0:
            break
        reason = next((line for line in run.stderr.splitlines() if "ERROR" in line or "runtime error" in line), "")
        reason = reason or (run.stderr.splitlines() or [""])[-1]
        first = last + 1
        if any(name in reason for name in NO_MEMORY):
            outcomes["MemoryError"] = outcomes.get("MemoryError", 0) + 1
            continue
        failures += 1
        print(f"call {last} of seed {given.seed}, {names[last % len(names)]}: ended with {run.returncode} {reason}")
    shown = ", ".join(f"{count} {name}" for name, count in sorted(outcomes.items(), key=lambda item: -item[1]))
    took = time.monotonic() - begin
    print(f"{len(names)} functions: {sum(outcomes.values())} passed ({shown}), {failures} failed in {took:.0f}s")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
