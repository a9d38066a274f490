"""The stub of the kernels is the one that nanobind writes for the built module."""

from pathlib import Path

from nanobind.stubgen import StubGen

from gmwm.base import _core

STUB = Path(__file__).parent.parent / "src/gmwm/base/_core.pyi"


def test_the_stub_is_that_of_the_built_module():
    generator = StubGen(_core)
    generator.put(_core)
    assert generator.get() == STUB.read_text(encoding="utf-8"), "the kernels' interface has changed: run make stub"
