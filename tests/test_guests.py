"""Entry points of other packages: each is admitted once, and one that fails gives one warning."""

from __future__ import annotations

import pytest

from gmwm.base.errors import GmwmWarning
from gmwm.base.extras import admit_guests
from tests.helpers import warns


@pytest.fixture
def package(tmp_path, monkeypatch):
    """An installed package with two entry points, one of which names a module that it lacks."""
    (tmp_path / "guest_module.py").write_text("VALUE = 7\n")
    metadata = tmp_path / "guest_package-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: guest-package\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[gmwm.tests]\nfirst = lacking:thing\nsecond = guest_module:VALUE\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield
    admit_guests.cache_clear()


def test_guests_are_admitted_once_and_a_broken_one_gives_one_warning(package):
    registry = []

    def admit(name, value):
        registry.append((name, value))

    with warns("guest-unusable", name="first", package="guest-package", group="gmwm.tests"):
        admit_guests("gmwm.tests", admit)
    admit_guests("gmwm.tests", admit)
    assert registry == [("second", 7)]


def test_a_registry_may_refuse_a_guest(package):
    with pytest.warns(GmwmWarning) as warnings:
        admit_guests("gmwm.tests", lambda name, value: value())
    assert [warning.message.remark.facts["name"] for warning in warnings] == ["first", "second"]
