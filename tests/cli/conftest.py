import json
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gmwm.cli.main import app
from gmwm.theory.simulation import simulate
from tests.json_outputs import check


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str

    @property
    def json(self):
        def refuse(word):
            raise AssertionError(f"{word} is not JSON")

        return json.loads(self.out, parse_constant=refuse)

    def require_refusal(self, *facts):
        """Nothing on stdout, and after warnings one line with an error that states the facts."""
        assert (self.code, self.out) == (2, "")
        (line,) = (line for line in self.err.splitlines() if not line.startswith("warning: "))
        assert line.startswith("error: ")
        assert all(str(fact) in line for fact in facts), (facts, line)


@pytest.fixture(scope="session")
def gmwm():
    """The command line in this process: `gmwm("fit", file, "--model", "WN")`."""

    def run(*arguments):
        result = CliRunner().invoke(app, [str(a) for a in arguments], prog_name="gmwm")
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        if "--json" in arguments and result.stdout.strip():
            check(str(arguments[0]), result.stdout)
        return Outcome(result.exit_code, result.stdout, result.stderr)

    return run


@pytest.fixture(scope="session")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("recordings")


MODELS = {"gyro": "WN(sigma2=4e-7) + RW(gamma2=1e-11)", "accel": "WN(sigma2=2e-5) + GM(beta=2.0, sigma2=2e-6)"}


@pytest.fixture(scope="session")
def recording(folder) -> Path:
    """Six axes, 200 s at 100 Hz, as CSV with names, units and time."""
    path = folder / "six.csv"
    simulate(MODELS, rate=100.0, samples=20_000, rng=5).write(path)
    return path


WITHIN = "GM + WN + RW"


@pytest.fixture(scope="session")
def calibrated(gmwm, recording, tmp_path_factory) -> tuple[Path, Outcome]:
    """The folder that `gmwm calibrate` wrote, which no test may change, and what it printed."""
    target = tmp_path_factory.mktemp("calibrate") / "new" / "results"
    return target, gmwm("calibrate", recording, "--within", WITHIN, "--output", target)


@pytest.fixture
def without_pictures(monkeypatch):
    """The pictures of a calibration with --output are empty, because to draw them takes a third of its time."""
    monkeypatch.setattr("gmwm.cli.calibrate.draw_pictures", empty_pictures)


def empty_pictures(*_) -> dict[str, bytes]:
    """Files of pictures without content. A helper gets this function by its name."""
    return dict.fromkeys(("calibration.png", "by_sensor.png"), b"")


@pytest.fixture(scope="session")
def unlabelled(folder) -> Path:
    """One gyroscope axis without time or unit."""
    path = folder / "one.csv"
    values = simulate({"gyro_x": "WN(sigma2=1e-4)"}, rate=100.0, samples=500, rng=6)["gyro_x"].values
    path.write_text("gyro_x\n" + "\n".join(map(repr, values.tolist())) + "\n")
    return path


@pytest.fixture(scope="session")
def broken(folder) -> Path:
    """One gyroscope axis with a gap of ten seconds after 300 samples of 500."""
    path = folder / "gap.csv"
    values = simulate({"gyro_x": "WN(sigma2=1e-4)"}, rate=100.0, samples=500, rng=7)["gyro_x"].values
    rows = [f"{k / 100 + (10 if k >= 300 else 0)!r},{v!r}" for k, v in enumerate(values.tolist())]
    path.write_text("time [s],gyro_x [rad/s]\n" + "\n".join(rows) + "\n")
    return path
