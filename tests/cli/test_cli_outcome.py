"""The outcome of a command: text, JSON, warnings and files."""

import json

import pytest

from gmwm.base.errors import DataError, OptionError
from gmwm.base.remarks import Dialect, Remark, Severity, messages
from gmwm.cli.options import named_as_options
from gmwm.cli.output import NewFile, Outcome, collect_warnings, finish, tell, text_file

SHAKEN = Remark.of("gravity-removed", "a.csv")
LISTED = Remark.of("last-line", "a.csv", case="read")


def finished(outcome, *, as_json=False, every=False, warnings=()):
    with collect_warnings(every=every) as warned:
        for remark in warnings:
            tell(remark)
        finish(outcome, warned, json=as_json, every=every)


def printed(remark):
    """The line on stderr for a remark."""
    return f"warning: {remark.text(Dialect.SHELL)} [{remark.code}]\n"


def test_text_then_files_then_closing(tmp_path, capsys):
    path = tmp_path / "a.txt"
    finished(Outcome(command="x", document={}, text="result", files=(text_file(path, "content\n"),), closing="end"))
    assert path.read_text() == "content\n"
    assert capsys.readouterr().out == f"result\n\nWrote {path}\nend\n"


def test_several_files_are_named_by_folder(tmp_path, capsys):
    files = tuple(text_file(tmp_path / name, "") for name in ("a.txt", "b.txt"))
    finished(Outcome(command="x", document={}, text="result", files=files))
    assert " ".join(capsys.readouterr().out.split()) == f"result Wrote to {tmp_path}: a.txt, b.txt"


def test_a_text_with_its_own_line_end_gets_no_second_one(capsys):
    finished(Outcome(command="x", document={}, text="a: 1\n"))
    assert capsys.readouterr().out == "a: 1\n"


def test_json_has_the_remarks_that_the_text_shows(capsys):
    outcome = Outcome(command="x", document={"n": 1}, text="result", remarks=(SHAKEN,), in_text=(LISTED,))
    finished(outcome)
    shown = capsys.readouterr()
    assert (shown.out, shown.err) == ("result\n", printed(SHAKEN))
    finished(outcome, as_json=True)
    shown = capsys.readouterr()
    assert json.loads(shown.out)["remarks"] == [LISTED.to_dict(), SHAKEN.to_dict()]
    assert shown.err == printed(SHAKEN)


def test_remarks_on_reading_are_shown_only_on_request(capsys):
    assert LISTED.severity is Severity.INFO
    outcome = Outcome(command="x", document={}, text="short", all_text="long")
    finished(outcome, warnings=[LISTED, SHAKEN, LISTED])
    shown = capsys.readouterr()
    assert (shown.out, shown.err) == ("short\n", printed(SHAKEN))
    finished(outcome, warnings=[LISTED, SHAKEN, LISTED], every=True)
    shown = capsys.readouterr()
    assert (shown.out, shown.err) == ("long\n", printed(SHAKEN) + printed(LISTED))


def test_the_five_most_severe_warnings_are_printed(capsys):
    known = [Remark.of(code, "a", **one.examples[0]) for code, one in messages().items()
             if one.severity in ("wrong", "biased", "uncertain") and "subject" not in one.examples[0]][:9]  # fmt: skip
    assert len(known) == 9
    outcome = Outcome(command="x", document={}, text="result")
    finished(outcome, warnings=known)
    lines = capsys.readouterr().err.splitlines()
    shown = [line.rpartition("[")[2].rstrip("]") for line in lines[:-1]]
    severities = [messages()[code].severity_for({}) for code in shown]
    assert severities == sorted(remark.severity for remark in known)[:5]
    assert "4 more" in lines[5]
    assert "--all-remarks" in lines[5]
    finished(outcome, warnings=known, every=True)
    assert len(capsys.readouterr().err.splitlines()) == 9


def test_warnings_are_printed_if_the_command_fails(capsys):
    def fails():
        with collect_warnings():
            tell(SHAKEN)
            raise DataError("too short")

    with pytest.raises(DataError):
        fails()
    assert capsys.readouterr().err == printed(SHAKEN)


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
    with pytest.raises(DataError, match=r"^cut short$"):
        finished(Outcome(command="x", document={}, text="what came before", failure=DataError("cut short")))
    assert capsys.readouterr().out == "what came before\n"


def test_errors_about_an_argument_name_its_option():
    with pytest.raises(OptionError) as caught, named_as_options({"format": "--to"}):
        raise OptionError(argument="format", expected="one of imu:IMAR", got="x", advice="Leave {--format=x} out.")
    assert caught.value.argument == "format"
    assert caught.value.text(Dialect.SHELL) == "--to must be one of imu:IMAR; got 'x'. Leave --to x out."
    assert caught.value.text() == "format must be one of imu:IMAR; got 'x'. Leave format='x' out."


@pytest.mark.parametrize(
    ("arguments", "got"),
    [
        (("--rate", "-1"), "-1.0"),
        (("--stop", "5s", "--start", "9s"), "5.0"),
        (("--skip", "5s-2s"), "(5.0, 2.0)"),
        (("--format", "nix"), "'nix'"),
    ],
)
def test_options_of_reading_are_refused_before_the_file_is_opened(gmwm, tmp_path, arguments, got):
    file = tmp_path / "no such file.csv" if "--format" not in arguments else __file__
    gmwm("info", file, *arguments).require_refusal(f"error: {arguments[0]} must be ", f"; got {got}")


@pytest.mark.parametrize("command", [("calibrate",), ("select",), ("fit", "--model", "WN"), ("track", "--model", "WN")])
def test_a_confidence_is_refused_before_the_file_is_opened(gmwm, command):
    done = gmwm(*command, "no such file.csv", "--confidence", "0.3")
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("error: --confidence must be ")
    assert "; got 0.3. " in done.err
