"""The codec of documents: keys, order, nested results, numbers that JSON lacks, and what it refuses."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from gmwm import Model
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.documents import Documented, indented_json, plain
from gmwm.base.errors import ReadError
from gmwm.base.kinds import Document
from tests.helpers import raises


@dataclass(frozen=True)
class Line:
    tau: float
    labels: tuple[str, ...]


@dataclass(frozen=True)
class Search(Documented):
    nodes: int
    converged: bool
    document_keys = ("search_nodes=nodes", "converged")


@dataclass(frozen=True, eq=False)
class Curve(Documented):
    model: Model
    variance: Vector
    scatter: Matrix
    lines: tuple[Line, ...]
    count: Mapping[int, float]
    search: Search
    note: str | None = None
    document = Document("curve", "Make it again.")
    document_keys = ("title=_title", "model", "size", "variance", "scatter~inf", "lines", "count", "*search", "note?")
    _title = "a curve"

    def size(self) -> int:
        return self.variance.size


@pytest.fixture
def curve():
    scatter = np.array([[1.0, 0.0], [0.0, np.inf]])
    return Curve(Model.parse("WN(sigma2=4)"), np.array([2.0, 1.0]), scatter, (Line(3.0, ("a", "b")),), {1: 2.5},
                 Search(7, True))  # fmt: skip


def through_json(result):
    return json.loads(json.dumps(result.to_dict(), allow_nan=False))


def test_keys_have_the_order_and_the_names_that_the_class_states(curve):
    assert curve.to_dict() == {
        "title": "a curve", "model": "WN(sigma2=4.0)", "size": 2, "variance": [2.0, 1.0],
        "scatter": [[1.0, 0.0], [0.0, None]],
        "lines": [{"tau": 3.0, "labels": ["a", "b"]}], "count": {1: 2.5}, "search_nodes": 7, "converged": True,
        "note": None,
    }  # fmt: skip
    assert list(curve.to_dict())[-3:] == ["search_nodes", "converged", "note"]


def test_everything_comes_back_with_its_type(curve):
    back = Curve.from_dict(through_json(curve))
    assert back.to_dict() == curve.to_dict()
    assert (back.model, back.lines, back.search, dict(back.count)) == (
        curve.model, curve.lines, curve.search, {1: 2.5},
    )  # fmt: skip
    assert back.scatter[1, 1] == math.inf
    assert isinstance(Curve.from_dict(through_json(curve) | {"lines": [{"tau": 3, "labels": []}]}).lines[0].tau, float)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"model": None}, "None"),
        ({"variance": [1.0, -2.0]}, "variance must not be negative"),
        ({"variance": "x"}, "x"),
        ({"search_nodes": "x"}, "search_nodes must be a whole number"),
        ({"converged": 1}, "converged must be true or false"),
        ({"lines": [{"tau": 0.0, "labels": []}]}, "tau must be above zero"),
        ({"lines": [{"tau": 1.0}]}, "'labels' is missing"),
    ],
)
def test_a_wrong_value_is_refused_by_its_name(curve, change, words):
    with raises(ReadError, words):
        Curve.from_dict(through_json(curve) | change)


def test_only_marked_keys_may_be_missing(curve):
    content = through_json(curve)
    del content["note"]
    assert Curve.from_dict(content).note is None
    with raises(ReadError, "'search_nodes' is missing"):
        Curve.from_dict({key: value for key, value in content.items() if key != "search_nodes"})


@dataclass(frozen=True, eq=False)
class Counted(Documented):
    count: int
    levels: NDArray[np.int64]
    document = Document("count", "Make it again.")


@pytest.mark.parametrize(
    ("key", "value"), [("count", 1.5), ("count", 1e400), ("levels", [1, 2.5]), ("levels", [1, None]), ("levels", ["x"])]
)
def test_no_number_is_rounded_to_a_whole_one(key, value):
    whole = {"count": 3.0, "levels": [1, 2.0]}
    assert Counted.from_dict(whole).to_dict() == {"count": 3, "levels": [1, 2]}
    with raises(ReadError, "not a count"):
        Counted.from_dict(whole | {key: value})


def test_plain_values():
    values = {"a": np.float64(1.5), "b": (np.int64(2), None), "c": math.nan}
    assert plain(values) == {"a": 1.5, "b": [2, None], "c": None}
    assert type(plain(values)["a"]) is float
    assert math.isnan(plain(values, finite=False)["c"])


@pytest.mark.parametrize("escaped", [True, False])
def test_indented_json_is_that_of_the_standard_library(escaped):
    value = {"a²": [[1.0, -0.0], [], {}, {"b": [True, None, '\n"[1, 2]']}], "c": (1, 2.5e-300), "d": {"e": {"f": 1}}}
    for content in (value, [], "²", 3.0, [value, "x"]):
        expected = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=escaped)
        assert indented_json(content, escaped=escaped) == expected
    with pytest.raises(ValueError, match="not JSON compliant"):
        indented_json({"x": [[math.inf]]})
