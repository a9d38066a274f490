"""The door of the server: each callback of a request is compared with the callbacks of the page, and each value is
checked by type, range and length before a function of the page sees it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from gmwm.applications.app.session import Session
from gmwm.base.errors import GmwmError

LARGEST_CALLBACK = 1_000_000
"""Largest size of the request of a callback (bytes)."""
LONGEST = {"reference": 100_000}
"""Largest length of the text of a field; 4000 for all others."""
RANGES = {"horizon": (-2.0, 3.0), "inflation": (1.0, 20.0)}
"""Ranges of the sliders."""


class ForgedRequestError(Exception):
    """A request that the page cannot have sent."""


def require_callback(body: Any, callbacks: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise a ForgedRequestError unless the page can send this request to one of the callbacks, which Dash lists by
    their outputs."""
    _require(isinstance(body, dict) and isinstance(body.get("output"), str), "it names no callback")
    callback = callbacks.get(body["output"], {})
    _require("callback" in callback, "no callback has this output")
    _require_outputs(body.get("outputs"), body["output"])
    for kind in ("inputs", "state"):
        items = body.get(kind, [])
        _require(isinstance(items, list) and len(items) == len(callback[kind]), f"it has other {kind}")
        for item, expected in zip(items, callback[kind], strict=True):
            _require_item(item, expected)
    changed = body.get("changedPropIds", [])
    _require(isinstance(changed, list) and len(changed) <= 1000, "its triggers are no list")
    for name in changed:
        _require(
            isinstance(name, str) and any(_is_name(name, expected) for expected in callback["inputs"]), "other trigger"
        )


def _require(condition: bool, reason: str) -> None:
    if not condition:
        raise ForgedRequestError(reason)


def _require_outputs(outputs: Any, output: str) -> None:
    """Require that the outputs are those of the callback."""
    listed = outputs if isinstance(outputs, list) else [outputs]
    _require(all(_is_item(item) and isinstance(item["id"], str) for item in listed), "it has other outputs")
    names = [f"{item['id']}.{item['property'].partition('@')[0]}" for item in listed]
    expected = output.strip(".").split("...") if output.startswith("..") else [output]
    _require(names == [name.partition("@")[0] for name in expected], "it has other outputs")


def _is_item(item: Any) -> bool:
    return isinstance(item, dict) and "id" in item and isinstance(item.get("property"), str)


def _require_item(item: Any, expected: Mapping[str, str]) -> None:
    """Require that a sent component, or each of a list of components, is the expected one, with a possible value."""
    if not expected["id"].startswith("{"):
        _require(
            _is_item(item) and item["id"] == expected["id"] and item["property"] == expected["property"], "other input"
        )
        require_value(expected["id"], expected["property"], item.get("value"))
        return
    _require(isinstance(item, list), "an input is no list")
    for member in item:
        _require(_is_item(member) and member["property"] == expected["property"], "other input")
        _require(_matches(member["id"], expected["id"]), "other input")
        require_value(member["id"]["type"], expected["property"], member.get("value"))


def _matches(name: Any, pattern: str) -> bool:
    """Return whether the name of a component belongs to a pattern, such as {"type": "axis", "axis": "gyro_x"}."""
    keys = json.loads(pattern)
    if not isinstance(name, dict) or name.keys() != keys.keys() or name["type"] != keys["type"]:
        return False
    return all(isinstance(text, str) and len(text) <= 4000 for text in name.values())


def _is_name(name: str, expected: Mapping[str, str]) -> bool:
    """Return whether a text names a component of an input and its property. The component may have been removed."""
    component, _, prop = name.rpartition(".")
    if not expected["id"].startswith("{") or not component.startswith("{"):
        return (component, prop) == (expected["id"], expected["property"])
    try:
        return prop == expected["property"] and _matches(json.loads(component), expected["id"])
    except ValueError:
        return False


def require_value(name: str, prop: str, value: Any) -> None:
    """Require that a property of the component `name` can have a value. None is a value that was never set."""
    if value is None and (name, prop) not in _NEVER_NONE:
        return
    if prop in ("n_clicks", "n_submit", "n_blur", "n_intervals"):
        _require(_is_count(value), f"{prop} of {name} is no count")
    elif prop == "relayoutData":
        _require(isinstance(value, dict) and _is_change(value), f"{prop} of {name} is no change of a figure")
    elif prop == "value" and name in RANGES:
        low, high = RANGES[name]
        _require(_is_number(value) and low <= value <= high, f"{name} is out of range")
    elif prop == "value":
        _require(isinstance(value, str) and len(value) <= LONGEST.get(name, 4000), f"{name} is no text, or too long")
    else:
        check = _DATA.get(name, _is_digest if name.endswith("-digest") else _refused)
        _require(prop == "data" and check(value), f"{name} has another kind of data")


def _refused(value: Any) -> bool:
    return False


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _is_count(value: Any) -> bool:
    return _is_number(value) and -1 <= value < 2**53 and value == math.floor(value)


def _is_change(value: Any, depth: int = 5) -> bool:
    """Return whether a value describes a change of a figure: a number, a text, or a short list or object of these."""
    if isinstance(value, list | dict):
        items = list(value.values()) if isinstance(value, dict) else value
        return depth > 0 and len(items) <= 64 and all(_is_change(item, depth - 1) for item in items)
    return (
        value is None or isinstance(value, bool) or _is_number(value) or (isinstance(value, str) and len(value) < 4000)
    )


def _is_session(value: Any) -> bool:
    try:
        return isinstance(value, dict) and bool(Session.from_dict(value).to_dict() or True)
    except GmwmError:
        return False


def _is_model_shown(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and _is_session(value[0]) and isinstance(value[1], str)


def _is_digest(value: Any) -> bool:
    return isinstance(value, str) and re.fullmatch("[0-9a-f]{64}", value) is not None


_DATA: Mapping[str, Callable[[Any], bool]] = {
    "session": _is_session, "model-shown": _is_model_shown, "restored": _is_count, "revision": _is_count,
    "page": lambda value: isinstance(value, str) and re.fullmatch("[0-9a-f]{32}", value) is not None,
    "dropped": lambda value: isinstance(value, str) and len(value) <= 4000,
    "width": lambda value: _is_number(value) and 1 <= value <= 100_000,
    "time-unit": lambda value: _is_number(value) and 0 < value < 1e12,
    "tab": lambda value: value in ("recording", "curves", "model", "numbers", "download"),
}  # fmt: skip
_NEVER_NONE = {(name, "data") for name in ("session", "page", "width", "tab", "time-unit", "revision", "restored")} | {
    (name, "value") for name in RANGES
}
