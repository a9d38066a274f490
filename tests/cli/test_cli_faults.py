"""The command as a program when the system fails: closed streams, full disks, signals, names that are not UTF-8."""

import os
import signal
import subprocess
import sys

import pytest

from gmwm.base.atomic_files import write_text, written_whole
from gmwm.showing.exporters.tables import _text

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs POSIX streams and signals")

COMMAND = [sys.executable, "-m", "gmwm"]


def run(*arguments, closed=(), **options):
    """Run the command; return its exit code and what it wrote to stdout and stderr. `closed` are descriptors."""

    def close():
        for descriptor in closed:
            os.close(descriptor)

    done = subprocess.run(
        [*COMMAND, *map(os.fspath, arguments)],
        capture_output=True,
        timeout=120,
        preexec_fn=close,
        **options,
        check=False,
    )
    return done.returncode, done.stdout.decode(), done.stderr.decode()


@pytest.mark.slow
@pytest.mark.parametrize("closed", [(1,), (2,), (0, 1, 2)])
def test_closed_streams(recording, closed):
    code, out, err = run("info", str(recording), closed=closed)
    assert (code, "Traceback" in err) == (0, False)
    assert bool(out) == (1 not in closed)
    if closed != (1,):  # what a file that is missing prints goes to the second
        code, _, err = run("info", "missing.csv", closed=closed)
        assert (code, "Traceback" in err) == (2, False)


@pytest.mark.slow
def test_a_closed_standard_input_is_an_empty_one():
    code, _, err = run("watch", "-", "--rate", "100", closed=(0,))
    assert (code, err.count("\n"), err.startswith("error: ")) == (2, 1, True)


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the system has no full device")
def test_a_full_output_is_one_line(recording):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*COMMAND, "info", str(recording)], stdout=full, stderr=subprocess.PIPE, timeout=120, check=False
        )
    assert (done.returncode, done.stderr.count(b"\n")) == (2, 1)


@pytest.mark.slow
def test_a_wrong_backend_of_matplotlib_does_not_matter(recording, tmp_path):
    picture = tmp_path / "curve.png"
    code, _, err = run("wv", str(recording), "--plot", picture, env=os.environ | {"MPLBACKEND": "nonsense"})
    assert (code, "Traceback" in err, picture.exists()) == (0, False, True)


def let_signals_in():
    """Undo what a shell does for a command in the background."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "module", "name"),
    [
        (signal.SIGTERM, "gmwm.files.readers.api", "read_file"),
        (signal.SIGINT, "gmwm.calibration.calibrate_recordings", "calibrate_axis"),
        (signal.SIGTERM, "gmwm.showing.reports.write", "write_text"),
        (signal.SIGINT, "os", "replace"),
        (signal.SIGHUP, "os", "replace"),
    ],
)
def test_a_signal_leaves_no_files(recording, forks, tmp_path, number, module, name):
    """Whenever it comes, from the reading to the renaming of the files."""
    words = ("calibrate", str(recording), "--axis", "gyro_x", "--within", "WN + RW", "--output", str(tmp_path / "out"))
    done = forks.run("tests.forked:gmwm_struck", module, name, str(int(number)), *words, folder=tmp_path)
    word = "interrupted\n" if number == signal.SIGINT else "terminated\n"
    assert (done.returncode, done.stderr) == (128 + number, word)
    assert list(tmp_path.glob("out/*")) == []


BESIDE = """
import atexit, os, signal, typer.main
def strike(*given):
    os.kill(os.getpid(), {number})
    return build(*given)
build = typer.main.get_command
{when}
from gmwm.cli import start
start()
"""


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("when", ["typer.main.get_command = strike", "atexit.register(strike)"])
def test_a_signal_before_and_after_a_command_ends_the_process(number, when):
    """While the commands are built, and while the interpreter ends."""
    done = subprocess.run(
        [sys.executable, "-c", BESIDE.format(number=int(number), when=when), "--version"],
        capture_output=True,
        timeout=100,
        preexec_fn=let_signals_in,
        check=False,
    )
    assert (done.returncode, done.stderr) == (-number, b"")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the file system accepts UTF-8 only")
def test_results_of_a_file_whose_name_is_not_utf8(recording, forks, tmp_path):
    odd = tmp_path / os.fsdecode(b"unit \xff.csv")
    odd.write_bytes(recording.read_bytes())
    words = ("calibrate", str(odd), "--axis", "gyro_x", "--within", "WN")
    output = ("--output", str(tmp_path / os.fsdecode(b"out \xff")))
    code, out, err = forks.run("tests.forked:gmwm", *words, *output, folder=tmp_path)
    assert (code, err.count("Traceback")) == (0, 0)
    assert "unit" in out
    assert {path.name for path in (tmp_path / os.fsdecode(b"out \xff")).iterdir()} >= {
        "calibration.json",
        "report.html",
    }
    missing = str(tmp_path / os.fsdecode(b"missing \xff.csv"))
    code, _, err = forks.run("tests.forked:gmwm", "info", missing, folder=tmp_path)
    assert code == 2
    assert "missing \\xff.csv" in err


def test_an_error_of_polars_names_the_file(tmp_path):
    class ComputeError(Exception):
        """As Polars raises it for a full disk."""

    ComputeError.__module__ = "polars.exceptions"
    for error in (ComputeError("No space left\nmore"), OSError("No space left")):
        with pytest.raises(OSError, match=r"No space left.*o\.csv") as caught, written_whole(tmp_path / "o.csv"):
            raise error
        assert (caught.value.filename, caught.value.strerror) == (str(tmp_path / "o.csv"), "No space left")
    assert list(tmp_path.iterdir()) == []


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "real.json").write_text("old")
    (tmp_path / "link.json").symlink_to("real.json")
    write_text(tmp_path / "link.json", "new")
    assert (tmp_path / "link.json").is_symlink()
    assert (tmp_path / "real.json").read_text() == "new"


@pytest.mark.parametrize("cell", ["=1+1", "+1", "-1", "@A1", "\t=1"])
def test_no_cell_is_a_formula(cell):
    assert _text(cell) == f"'{cell}"
