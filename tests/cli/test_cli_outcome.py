"""The outcome of a command: one writer makes text, JSON, warnings and files of it."""

import json

import pytest

from gmwm.cli.option_names import named_as_options, option_of
from gmwm.cli.output import NewFile, Outcome, finish, text_file, told_warnings
from gmwm.errors import DataError, OptionError


def finished(outcome, *, as_json=False):
    with told_warnings() as told:
        finish(outcome, told, json=as_json)


def test_text_then_files_then_closing(tmp_path, capsys):
    path = tmp_path / "a.txt"
    finished(Outcome(command="x", document={}, text="result", files=(text_file(path, "content\n"),), closing="end"))
    assert path.read_text() == "content\n"
    assert capsys.readouterr().out == f"result\n\nWrote\n  {path}\nend\n"


def test_a_text_with_its_own_line_end_gets_no_second_one(capsys):
    finished(Outcome(command="x", document={}, text="a: 1\n"))
    assert capsys.readouterr().out == "a: 1\n"


def test_json_has_the_remarks_that_the_text_shows(capsys):
    outcome = Outcome(command="x", document={"n": 1}, text="result", remarks=("one",), in_text=("two",))
    finished(outcome)
    shown = capsys.readouterr()
    assert (shown.out, shown.err) == ("result\n", "warning: one\n")
    finished(outcome, as_json=True)
    shown = capsys.readouterr()
    assert json.loads(shown.out)["warnings"] == ["two", "one"]
    assert shown.err == "warning: two\nwarning: one\n"


def test_files_that_belong_together_are_written_all_or_none(tmp_path):
    (tmp_path / "old.txt").write_text("of an earlier run")
    (tmp_path / "a.txt").write_text("of an earlier run")

    def fails(path):
        raise DataError("cannot be drawn")

    files = (text_file(tmp_path / "a.txt", "new"), NewFile(tmp_path / "b.png", fails))
    with pytest.raises(DataError):
        finished(Outcome(command="x", document={}, files=files, together=True, obsolete=(tmp_path / "old.txt",)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "old.txt"]
    assert (tmp_path / "a.txt").read_text() == "of an earlier run"
    finished(Outcome(command="x", document={}, files=files[:1], together=True, obsolete=(tmp_path / "old.txt",)))
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "new"


def test_a_failure_follows_the_result(capsys):
    with pytest.raises(DataError, match="cut short"):
        finished(Outcome(command="x", document={}, text="what came before", failure=DataError("cut short")))
    assert capsys.readouterr().out == "what came before\n"


def test_errors_about_an_argument_name_its_option():
    assert option_of("axes") == "--axis"
    with pytest.raises(OptionError, match=r"^--axis must be one of"), named_as_options({"axes": option_of("axes")}):
        raise OptionError("axes must be one of gyro_x")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--rate", "-1"), "error: --rate must be positive and finite"),
        (("--start", "9s", "--stop", "5s"), "error: --stop must come after --start 9 s"),
        (("--skip", "5s-2s"), "error: --skip must hold pairs with the earlier time first"),
        (("--format", "nix"), "error: --format must be one of"),
    ],
)
def test_options_of_reading_are_refused_before_the_file_is_opened(gmwm, tmp_path, arguments, words):
    file = tmp_path / "no such file.csv" if "--format" not in arguments else __file__
    done = gmwm("info", file, *arguments)
    assert done.code == 2
    assert done.err.startswith(words)


@pytest.mark.parametrize("command", [("calibrate",), ("select",), ("fit", "--model", "WN"), ("track", "--model", "WN")])
def test_a_confidence_is_refused_before_the_file_is_opened(gmwm, command):
    done = gmwm(*command, "no such file.csv", "--confidence", "0.3")
    assert (done.code, done.out) == (2, "")
    assert "--confidence must be at least 0.5 and less than 1, got 0.3; 95 % is 0.95" in done.err
