"""What the API pages show is told whole: every parameter, every field, what comes back, what is raised, an example."""

import dataclasses
import inspect
import re
from functools import cached_property
from importlib import import_module

from docs._site.docstrings import with_returned
from tests.docs.pages import DOCS
from tests.helpers import each

ENTRY = re.compile(r"^\.\. auto(?:function|class):: (gmwm\.\S+)\n((?:   :.*\n)*)", re.MULTILINE)
NO_EXAMPLE = {
    "plot_imu": "draws, as every result does in the gallery",
}
CANNOT_FAIL = {
    "export_formats": "takes nothing",
    "register": "imports the function when it is used",
    "example_recording": "takes nothing",
    "reference_imu": "takes nothing",
}


def named(name):
    """The thing that a dotted name stands for."""
    parts = name.split(".")
    for cut in range(len(parts) - 1, 0, -1):
        try:
            thing = import_module(".".join(parts[:cut]))
            for part in parts[cut:]:
                thing = getattr(thing, part)
        except (ImportError, AttributeError):
            continue
        return thing
    raise AssertionError(name)


def entries():
    """Name, thing and whether its members are shown, of each function and class of the API pages."""
    for page in sorted((DOCS / "api").glob("*.md")):
        for name, options in ENTRY.findall(page.read_text(encoding="utf-8")):
            yield name, named(name), "no-members" not in options


def methods(thing):
    """Name and function of each public method that a class defines, or has from a class of methods."""
    owners = [thing, *(base for base in thing.__mro__[1:] if base.__name__.endswith("Methods"))]
    for name, value in (item for owner in owners for item in vars(owner).items()):
        if name.startswith("_") or isinstance(value, property | cached_property):
            continue
        if inspect.isfunction(function := getattr(value, "__func__", value)):
            yield name, function


def listed(words):
    """The names that the sections of parameters and attributes have entries for."""
    found, section = set(), ""
    lines = words.splitlines()
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        if re.fullmatch("-{3,}", following):
            section = line
        elif section in ("Parameters", "Attributes") and re.match(r"[\w*]", line):
            found.update(name.strip().lstrip("*") for name in line.split(" : ")[0].split(","))
    return found


def untold(function, words, around="", itself=0):
    """Parameters without an entry that neither the words name nor, marked, those of the class around."""
    parameters = [name for name in list(inspect.signature(function).parameters)[itself:] if name[0] != "_"]
    known = listed(words)
    return [
        name
        for name in parameters
        if name not in known and not re.search(rf"\b{name}\b", words) and f"`{name}`" not in around
    ]


API = {name: (thing, shown) for name, thing, shown in entries()}
FUNCTIONS = {name: thing for name, (thing, _) in API.items() if inspect.isfunction(thing)}
CLASSES = {name: thing for name, (thing, _) in API.items() if inspect.isclass(thing)}


def test_there_is_an_api():
    assert len(FUNCTIONS) > 30
    assert len(CLASSES) > 50


def test_parameters_and_fields_that_nobody_tells_of_are_found():
    def function(told, also, silent):
        """Of `also`.

        Parameters
        ----------
        told : int
        """

    words = inspect.getdoc(function)
    assert untold(function, words) == ["silent"]
    assert untold(function, words, "what `silent` is") == []
    assert listed("What.\n\nAttributes\n----------\na, b : int\n    One c : of them.\n") == {"a", "b"}


@each("name", FUNCTIONS)
def test_every_parameter_of_a_function_is_told_of(name):
    assert untold(FUNCTIONS[name], inspect.getdoc(FUNCTIONS[name]) or "") == []


@each("name", [name for name in CLASSES if API[name][1]])
def test_every_parameter_of_a_method_is_told_of(name):
    around = inspect.getdoc(CLASSES[name]) or ""
    silent = {}
    for method, function in methods(CLASSES[name]):
        words = inspect.getdoc(function)
        assert words, f"{name}.{method}"
        # The first is the object, or the class.
        silent[method] = untold(function, words, around, itself=1)
    assert {method: names for method, names in silent.items() if names} == {}


@each("name", [name for name in CLASSES if dataclasses.is_dataclass(CLASSES[name])])
def test_every_field_of_a_class_is_told_of(name):
    fields = {field.name for field in dataclasses.fields(CLASSES[name]) if field.name[0] != "_"}
    assert fields - listed(inspect.getdoc(CLASSES[name]) or "") == set()


SHORT_WORDS = ("gmwm.units.", "gmwm.readers.")
"""Packages whose functions take one or two plain arguments."""


@each("name", [name for name in FUNCTIONS if not name.startswith(SHORT_WORDS)])
def test_a_function_of_the_package_shows_an_example_and_says_what_it_raises(name):
    words, short = inspect.getdoc(FUNCTIONS[name]) or "", name.rpartition(".")[2]
    parameters = inspect.signature(FUNCTIONS[name]).parameters
    # A reason that is no longer needed is not kept.
    assert (">>> " in words) != (short in NO_EXAMPLE)
    assert ("Raises\n------" in words) != (short in CANNOT_FAIL)
    assert "Returns" in with_returned(FUNCTIONS[name], words.splitlines()) or len(parameters) < 3


@each("name", [name for name, (thing, shown) in API.items() if inspect.isclass(thing) and not shown])
def test_a_process_shows_an_example(name):
    assert ">>> " in (inspect.getdoc(CLASSES[name]) or "")
