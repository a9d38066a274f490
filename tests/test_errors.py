"""Errors carry what is wrong as data, and are made text once for each kind of reader."""

import pickle

import pytest

from gmwm.base.errors import DataError, ModelError, OptionError, ReadError
from gmwm.base.template import Dialect


def test_an_argument_is_named_as_an_option_in_the_shell():
    error = OptionError(argument="gaps", expected="'keep' or 'longest'", got="all", advice="Pass {--gaps=longest}.")
    assert str(error) == "gaps must be 'keep' or 'longest'; got 'all'. Pass gaps='longest'."
    assert error.text(Dialect.SHELL) == "--gaps must be 'keep' or 'longest'; got 'all'. Pass --gaps longest."
    assert (error.argument, error.got, error.given) == ("gaps", "all", True)


def test_names_that_look_like_options_stay_as_they_are():
    error = ReadError("rate=100/{none}.csv does not exist", advice="Pass {--rate}.")
    assert error.text(Dialect.SHELL) == "rate=100/{none}.csv does not exist. Pass --rate."


def test_an_error_survives_pickling():
    error = OptionError(argument="rate", expected="positive", got=-1, advice="Use {limit}.", limit=3)
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.argument, again.got, again.facts) == (str(error), "rate", -1, {"limit": 3})


def test_what_was_given_is_shown_short():
    with pytest.raises(OptionError) as caught:
        raise OptionError(argument="x", expected="short", got="a" * 10_000)
    assert len(str(caught.value)) < 250


def test_an_error_names_its_subject_once():
    error = DataError("the signal has gaps", advice="Pass {--gaps=longest}.").about("gyro_x").about("imu.csv")
    assert (error.subject, str(error)) == ("gyro_x", "gyro_x: the signal has gaps. Pass gaps='longest'.")
    assert DataError("gyro_x must be finite", argument="gyro_x").about("gyro_x").subject == ""


def test_a_reason_leaves_out_subject_prefix_and_advice():
    error = ModelError("no process has this name", advice="Use WN.").about("gyro_x")
    error.prefix = "within"
    assert error.reason == "no process has this name"
    assert error.text(Dialect.SHELL) == "gyro_x: --within: no process has this name. Use WN."
    assert OptionError(argument="rate", expected="positive", got=-1).reason == "rate must be positive; got -1"


@pytest.mark.parametrize("long", ["x" * 100_000, "\x1b[2J" * 1000, "\u202egnp.exe", "\ud800", "a\u2028b"])
def test_no_error_is_long_or_changes_the_terminal(long):
    """Whatever a file puts into the message, the subject or the advice."""
    error = ReadError(f"column {long} is wrong", advice="Leave {axis} out with {--columns}.", axis=long).about(long)
    for dialect in (Dialect.PYTHON, Dialect.SHELL):
        text = error.text(dialect)
        assert len(text) < 3000
        assert text.isprintable()
        text.encode()
