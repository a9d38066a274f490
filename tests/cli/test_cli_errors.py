"""Every planned error is one line on stderr with exit code 2, and says what to type."""

import pytest

CASES = {
    "no such file": (["info", "{folder}/none.csv"], "none.csv does not exist"),
    "directory": (["wv", "{folder}"], "directory"),
    "empty file": (["info", "{empty}"], "empty"),
    "foreign file": (["info", "{foreign}"], "foreign.bin"),
    "no command of this name": (["ranking"], "no such command 'ranking'; see gmwm --help"),
    "no option of this name": (["wv", "{file}", "--bad"], "no such option: --bad; see gmwm wv --help"),
    "missing file": (["fit", "--model", "WN"], "see gmwm fit --help"),
    "missing model": (["fit", "{file}"], "missing option '--model'"),
    "rate is no number": (["wv", "{file}", "--rate", "fast"], "--rate takes a number, without a unit; see"),
    "seed is no number": (["demo", "--seed", "1.5"], "--seed takes a whole number; see gmwm demo --help"),
    "rate is negative": (["wv", "{file}", "--rate=-1"], "must be positive"),
    "rate contradicts the stamps": (["wv", "{file}", "--rate", "50"], "--rate 50"),
    "unknown choice": (["fit", "{file}", "-m", "WN", "--weighting", "best"], "'best' is not one of"),
    "unknown process": (["fit", "{file}", "-m", "WN + VN"], "no process of this name"),
    "empty model": (["fit", "{file}", "-m", ""], "model"),
    "too large a model": (["fit", "{file}", "-m", "12*GM"], "gyro_x"),
    "nothing to estimate": (
        ["fit", "{file}", "-m", "WN(sigma2=fixed(1.0))", "--axis", "gyro_x"],
        "nothing to estimate",
    ),
    "unknown axis": (["wv", "{file}", "--axis", "gyro_w"], "--axis must be one of gyro_x, "),
    "gaps": (["allan", "{broken}"], "pass --gaps longest"),
    "nothing left": (["info", "{file}", "--start", "10min"], "nothing is left between --start, --stop and --skip"),
    "a start without a length": (["info", "{file}", "--start", "later"], "--start takes a length as 90s"),
    "stop before start": (["info", "{file}", "--start", "1min", "--stop", "5s"], "stop must come after --start 60 s"),
    "half a skip": (["info", "{file}", "--skip", "20s"], "--skip takes two times"),
    "no rate": (["wv", "{unlabelled}", "--units", "gyro=rad/s"], "--rate is needed"),
    "no unit": (["wv", "{unlabelled}", "--rate", "100"], "--units gyro=deg/s or --units gyro=rad/s"),
    "units without a sensor": (["wv", "{file}", "--units", "deg/s"], "--units takes a unit for"),
    "unknown unit": (["wv", "{unlabelled}", "--rate", "100", "--units", "gyro=furlong"], "furlong"),
    "columns without an axis": (["wv", "{file}", "--columns", "gyro_x=a,b"], "--columns takes axis=COLUMN"),
    "columns by a lone name": (["wv", "{file}", "--columns", "gyro_x"], "nothing between two commas to leave one out"),
    "columns by an unknown name": (["wv", "{file}", "--columns", "foo"], "--columns must name gyro_x"),
    "column of no axis": (["wv", "{file}", "--columns", "foo=1"], "--columns must name gyro_x"),
    "names that repeat": (["info", "{repeated}"], "--columns time=0,gyro_x=1"),
    "a unit of time that is not clear": (
        ["info", "{unclear}"],
        "--units time=s, --units time=ms, --units time=us or --units time=ns",
    ),
    "a pipe": (["info", "/dev/null"], "pipe"),
    "stamps out of order": (["wv", "{disorder}"], "with --columns time= and pass --rate"),
    "output is a file": (["fit", "{file}", "-m", "WN", "--output", "{file}"], "--output must be a directory"),
    "demo into a file": (["demo", "--output", "{file}"], "--output must be a directory"),
    "simulate an axis that is none": (
        ["simulate", "-m", "foo=WN(sigma2=1)", "--duration", "1", "-o", "{folder}/x.csv"],
        "got 'foo'",
    ),
    "simulate without one value": (
        ["simulate", "-m", "GM(sigma2=1)", "--duration", "1", "-o", "{folder}/x.csv"],
        'as "GM(beta=…, sigma2=1)"',
    ),
    "columns that are not there": (["wv", "{file}", "--columns", "gyro_x=wx"], "wx"),
    "plot of unknown kind": (["wv", "{file}", "--plot", "{folder}/wv.foo"], "wv.foo"),
    "output in a file": (["fit", "{file}", "-m", "WN", "--output", "{file}/out"], "six.csv"),
    "csv in a file": (["wv", "{file}", "--csv", "{file}/out.csv"], "six.csv"),
    "simulate nothing": (["simulate", "--duration", "1", "--output", "{folder}/x.csv"], "--model or as --reference"),
    "simulate both": (
        ["simulate", "--reference", "-m", "WN(sigma2=1)", "--duration", "1", "--output", "{folder}/x.csv"],
        "one of them",
    ),
    "simulate without values": (["simulate", "-m", "WN", "--duration", "1", "--output", "{folder}/x.csv"], "WN.sigma2"),
    "simulate an axis twice": (
        ["simulate", "-m", "gyro=WN(sigma2=1)", "-m", "gyro=QN(q2=1)", "--duration", "1", "-o", "{folder}/x.csv"],
        "given twice for gyro",
    ),
    "simulate several without axes": (
        ["simulate", "-m", "WN(sigma2=1)", "-m", "QN(q2=1)", "--duration", "1", "-o", "{folder}/x.csv"],
        "each needs its axis",
    ),
    "simulate too short": (["simulate", "--reference", "--duration", "0", "-o", "{folder}/x.csv"], "duration"),
    "simulate without end": (["simulate", "--reference", "--duration", "inf", "-o", "{folder}/x.csv"], "duration"),
    "simulate for no length": (
        ["simulate", "--reference", "--duration", "long", "-o", "{folder}/x.csv"],
        "--duration takes a length as 90s, 30min, 1h30m, 2h or 1d, or in seconds; got 'long'",
    ),
    "a horizon without a length": (["export", "{file}", "--horizon", "near"], "--horizon takes a length as 90s"),
    "simulate more than memory": (["simulate", "--reference", "--duration", "1e13", "-o", "{folder}/x.csv"], "memory"),
    "simulate to an unknown format": (["simulate", "--reference", "--duration", "1", "-o", "{folder}/x.foo"], ".csv"),
    "negative seed": (
        ["simulate", "--reference", "--duration", "1", "--seed=-1", "-o", "{folder}/x.csv"],
        "--seed must be 0 or more",
    ),
}


@pytest.fixture(scope="session")
def places(folder, recording, unlabelled, broken):
    empty, foreign = folder / "empty.csv", folder / "foreign.bin"
    empty.touch()
    foreign.write_bytes(bytes(range(256)) * 8)
    texts = {
        "repeated": "time [s],gx [rad/s],gx [rad/s]\n" + "".join(f"{k / 100},{k % 7},{k % 3}\n" for k in range(50)),
        "unclear": "t,gx [rad/s]\n" + "".join(f"{10_000 * k},{k % 7}\n" for k in range(50)),
        "disorder": "t [s],gx [rad/s]\n" + "".join(f"{(k ^ 3) / 100},{k % 7}\n" for k in range(50)),
    }
    for name, text in texts.items():
        (folder / f"{name}.csv").write_text(text)
    return {
        "folder": folder, "file": recording, "unlabelled": unlabelled, "broken": broken,
        "empty": empty, "foreign": foreign, **{name: folder / f"{name}.csv" for name in texts},
    }  # fmt: skip


@pytest.mark.parametrize("json", [False, True], ids=["words", "json"])
@pytest.mark.parametrize("case", CASES)
def test_one_readable_line(gmwm, places, case, json):
    arguments, says = CASES[case]
    named = [text.format(**places) if "{" in text else text for text in arguments]
    outcome = gmwm(*named, *(["--json"] if json else []))
    assert outcome.code == 2
    assert outcome.out == ""
    lines = outcome.err.splitlines()
    assert [line for line in lines if not line.startswith("warning: ")] == lines[-1:]
    assert lines[-1].startswith("error: ")
    assert says in lines[-1]
    assert "Traceback" not in outcome.err


def test_a_failed_command_leaves_no_file(gmwm, folder):
    before = sorted(folder.iterdir())
    gmwm("simulate", "-m", "WN", "--duration", "1", "--output", folder / "x.csv")
    assert sorted(folder.iterdir()) == before


def test_a_bug_is_not_hidden(gmwm, recording, monkeypatch):
    def fall(*_, **__):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("gmwm.inspection.inspect", fall)
    with pytest.raises(ZeroDivisionError):
        gmwm("info", recording)


def test_an_interrupt_ends_with_130(gmwm, recording, monkeypatch):
    def press(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("gmwm.inspection.inspect", press)
    outcome = gmwm("info", recording)
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "interrupted\n")


def test_a_warning_is_one_line(gmwm, folder):
    path = folder / "plain.csv"
    noise = [0.001 * (k * 7 % 5) for k in range(200)]
    rows = [f"{k / 100},{x},{2 * x},{1 + x}\n" for k, x in enumerate(noise)]
    path.write_text("time [s],accel_x,accel_y,accel_z\n" + "".join(rows))
    outcome = gmwm("wv", path, "--json")
    (line,) = outcome.err.splitlines()
    assert line.startswith("warning: ")
    assert "--units accel=g" in line
    assert outcome.json["warnings"] == [line.removeprefix("warning: ")]
