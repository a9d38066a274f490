"""Only files in the folder that the user opened, and dropped files, can be opened."""

import io
import os

import pytest

from gmwm.applications.app import folders as app_folders
from gmwm.applications.app.folders import Folders
from gmwm.base.errors import OptionError, ReadError
from tests.helpers import raises


@pytest.fixture
def folders(tmp_path):
    for name in ("open/inner", "dropped", "secret"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("open/a.csv", "open/inner/b.csv", "open/.hidden", "secret/c.csv"):
        (tmp_path / name).write_text("x")
    (tmp_path / "open" / "link").symlink_to(tmp_path / "secret")
    return Folders((tmp_path / "open").resolve(), (tmp_path / "dropped").resolve())


def test_files_inside_are_found(folders):
    assert folders.file("a.csv") == folders.root / "a.csv"
    assert folders.file("inner/../inner/b.csv") == folders.root / "inner" / "b.csv"
    assert folders.file(str(folders.root / "a.csv")) == folders.root / "a.csv"


@pytest.mark.parametrize(
    "path", ["../secret/c.csv", "link/c.csv", "/etc/passwd", "..", "~", "inner/../../secret/c.csv"]
)
def test_a_path_outside_is_refused(folders, path):
    with raises(OptionError, argument="file", got=path):
        folders.file(path)
    with raises(OptionError, argument="file", got=path):
        folders.entries(path)


def test_a_path_outside_does_not_tell_whether_it_exists(folders):
    for path in ("../secret/c.csv", "../secret/none.csv"):
        with raises(OptionError, argument="file"):
            folders.file(path)
    with raises(ReadError):
        folders.file("none.csv")
    with raises(OptionError, argument="file"):
        folders.file("a\0.csv")


def test_a_listing_has_neither_hidden_files_nor_links_that_lead_outside(folders):
    assert folders.entries(".") == (".", ["inner"], ["a.csv"])
    assert folders.entries("inner") == ("inner", [], ["b.csv"])
    with raises(ReadError):
        folders.entries("a.csv")


@pytest.mark.parametrize("name", ["x.csv", "../../x.csv", "/etc/x.csv", "a\\x.csv"])
def test_a_dropped_file_stays_in_its_folder(folders, name):
    path = folders.store(name, io.BytesIO(b"dropped"))
    assert path.name == "x.csv"
    assert path.parent.parent == folders.dropped
    assert path.read_bytes() == b"dropped"
    assert folders.file(str(path)) == path


def test_a_dropped_file_without_a_name_is_stored(folders):
    for name in ("", "..", "."):
        assert folders.store(name, io.BytesIO(b"x")).parent.parent == folders.dropped


def test_two_drops_of_one_name_are_two_files(folders):
    first, second = (folders.store("x.csv", io.BytesIO(content)) for content in (b"first", b"second"))
    assert (first.read_bytes(), second.read_bytes()) == (b"first", b"second")


@pytest.mark.parametrize("name", ["a\0b.csv", "x" * 1000 + ".csv", "\ud800.csv", "line\nbreak.csv"])
def test_a_hostile_name_is_stored_under_a_safe_one(folders, name):
    path = folders.store(name, io.BytesIO(b"x"))
    assert path.suffix == ".csv"
    assert path.read_bytes() == b"x"


def test_a_drop_that_is_too_large_leaves_nothing(folders, monkeypatch):
    monkeypatch.setattr(app_folders, "LARGEST_DROP", 10)
    with raises(ReadError, code="too-large"):
        folders.store("x.csv", io.BytesIO(b"x" * 11))
    assert os.listdir(folders.dropped) == []
