"""A fleet in processes on this machine: the same results, lost processes, Ctrl-C, and scripts without a main block."""

import os
import subprocess
import sys
from contextlib import suppress
from multiprocessing import active_children

import pytest

from gmwm import fleet, simulate
from gmwm.applications.fleets.engine import Processes, run_jobs
from gmwm.applications.fleets.unit_job import UnitJob, UnitOptions
from gmwm.calibration.options import CalibrationOptions
from gmwm.recording.options import ReadOptions

pytestmark = pytest.mark.slow

WITHIN = "WN + RW"


@pytest.fixture
def few(tmp_path):
    """Six small recordings."""
    folder = tmp_path / "in"
    folder.mkdir()
    for k in range(6):
        simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=2000, rng=k).write(folder / f"{k}.parquet")
    return folder


def test_worker_processes_of_its_own_find_the_same(few, tmp_path):
    one, other = tmp_path / "here", tmp_path / "there"
    fleet(few, one, within=WITHIN, workers=0)
    found = fleet(few, other, within=WITHIN, workers=1)
    assert found.done == 6
    for unit in found:
        assert (one / "units" / f"{unit}.json").read_bytes() == (other / "units" / f"{unit}.json").read_bytes()
    assert (one / "fleet.parquet").read_bytes() == (other / "fleet.parquet").read_bytes()


class Deadly(int):
    """A number of threads that ends a process of the fleet, but not the one that makes it, when it is compared."""

    def __new__(cls, value, file=None):
        self = super().__new__(cls, value)
        self.first, self.file = os.getpid(), file
        return self

    def __reduce__(self):
        return _deadly, (int(self), self.first, self.file)

    def __lt__(self, other):
        if os.getpid() != self.first:
            if self.file is None:
                os._exit(9)
            with suppress(FileExistsError):
                self.file.touch(exist_ok=False)
                os._exit(9)
        return super().__lt__(other)


def _deadly(value, first, file):
    made = Deadly(value, file)
    made.first = first
    return made


def test_a_unit_that_kills_its_process_fails_and_one_that_does_so_once_does_not(few, tmp_path):
    asked = UnitOptions(CalibrationOptions(within=WITHIN), ReadOptions())
    jobs = [UnitJob(path.name, str(path), asked, 1) for path in sorted(few.iterdir())]
    jobs.insert(2, UnitJob("deadly", jobs[0].path, asked, Deadly(1)))
    jobs.insert(4, UnitJob("once", jobs[0].path, asked, Deadly(1, tmp_path / "died")))
    with Processes(2) as processes:
        outcomes = list(run_jobs(jobs, processes, retries=1))
    assert sorted(one.unit for one in outcomes) == sorted(job.unit for job in jobs)
    (failed,) = (one for one in outcomes if one.document is None)
    assert (failed.unit, (tmp_path / "died").exists()) == ("deadly", True)
    assert failed.reason.startswith("its worker process died 2 times without another job")
    # The jobs whose processes ended come last.
    assert {one.unit for one in outcomes[-2:]} == {"deadly", "once"}


def test_ctrl_c_ends_the_processes(few, tmp_path):
    def interrupt(done, units, text):
        raise KeyboardInterrupt

    before = active_children()
    with pytest.raises(KeyboardInterrupt):
        fleet(few, tmp_path / "out", within=WITHIN, workers=2, progress=interrupt)
    assert active_children() == before
    found = fleet(few, tmp_path / "out", within=WITHIN, workers=0)
    assert (found.kept, found.done) == (1, 5)


def test_a_script_without_a_main_block_is_told_and_nothing_is_written(few, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(f"import gmwm; gmwm.fleet({str(few)!r}, 'out', within='WN', workers=1)")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert 'put its work under `if __name__ == "__main__":`' in done.stderr.splitlines()[-1]
    assert not (tmp_path / "out").exists()
