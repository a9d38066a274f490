"""A process that tries changed files one after the other, and reports each on stdout: `python -m tests.fuzz.worker`.

It is a process of its own, so that a hang in a library can be ended, and a crash does not end the run.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

import numpy as np

from tests.fuzz import corpus, trials
from tests.fuzz.mutations import changed_bytes, changed_document

ADDRESSES = 12 << 30
"""Limit of the address space (bytes). Polars reserves some gigabytes that it does not use."""


def _told(**content: object) -> None:
    sys.stdout.write(json.dumps(content) + "\n")
    sys.stdout.flush()


def _memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


class Inputs:
    """The inputs of a family: each follows from its number and its seed. The inputs take the seeds in turn."""

    def __init__(self, family: str, seed: int, seeds: int, folder: Path) -> None:
        self.seed, self.seeds, self.folder, self.documents = seed, seeds, folder, family == "documents"
        self.files = list((corpus.FAMILIES | corpus.OTHERS)[family](folder))

    def write(self, number: int) -> Path:
        """Write an input, and return its path."""
        rng = np.random.default_rng([self.seed + number // len(self.files) % self.seeds, number])
        name, content = self.files[number % len(self.files)]
        if self.documents and rng.random() < 0.8:
            content = trials.dumped(changed_document(json.loads(content), rng))
        else:
            content = changed_bytes(content, rng)
        path = (self.folder / "fleet" if name == "fleet.json" else self.folder) / name
        path.write_bytes(content)
        return path


def main(family: str, seed: int, seeds: int, first: int, last: int) -> None:
    """Try the inputs from the number `first` to `last` (excluded)."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with tempfile.TemporaryDirectory() as folder:
        inputs = Inputs(family, seed, seeds, Path(folder))
        trial = trials.TRIALS.get(family, trials.read_trial)
        counts: Counter[str] = Counter()
        for number in range(first, last):
            path = inputs.write(number)
            _told(begin=number, path=str(path))
            start = time.process_time()
            try:
                counts[trial(path)] += 1
            except MemoryError:
                _told(failed=number, path=str(path), why="MemoryError")
            except BaseException as error:
                lines = traceback.format_exc().splitlines()
                _told(failed=number, path=str(path), why=f"{type(error).__name__}: {error}"[:500], trace=lines[-14:])
            _told(end=number, seconds=time.process_time() - start, memory=_memory(), counts=counts)


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:6]))
