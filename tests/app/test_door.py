"""Callbacks that the page cannot send are refused, and the server answers the others."""

import contextlib
import io
import json
import secrets

import numpy as np
import pytest

import gmwm

pytest.importorskip("dash", reason="needs Dash: pip install '.[app]'")

from gmwm.applications.app.server import LARGEST_CALLBACK, application, open_path
from gmwm.applications.app.workspace import Desk

pytestmark = pytest.mark.slow

BASE, TOKEN, PAGE = "http://127.0.0.1:5", "token", secrets.token_hex(16)
VALUES = {
    "horizon": 0.0, "inflation": 1.0, "units": "si", "view": "allan", "curve": "both", "robust": "auto",
    "confidence": "0.9", "duration": "60s", "format": "kalibr", "rule": "", "model": "GM + WN", "term": "WN",
    "path": "a.csv", "span-from": "1s", "span-to": "2s", "reference": "gyro.N = 2 deg/√h",
}  # fmt: skip
KEYS = {"axis": "gyro_x", "term": "WN", "parameter": "WN.sigma2", "model": "WN", "span": "0", "path": "a.csv"}
HOSTILE = (
    True, 0, -1, 10**30, 10**400, 1e308, float("nan"), float("inf"), "", "x" * 5000, "9" * 5000, "\0", [], {}, [[[]]],
    {"a": 1}, "../../etc/passwd", "1e400", "AR(100000)", "99999999*GM", "GM" + " + GM" * 300, "nan", "-1", "=", "(((",
    [1] * 2000, {"type": "axis"}, "__proto__", 3.5, False, "SARMA(1, 1, 1, 1, 1000000)", "WN(sigma2=fixed(-1))",
    "GM(beta=fixed(1e300))", "1/0", "gyro=1/0", "gyro=1e999", "12h", "1e300s", "a.csv", "b", "session.json",
)  # fmt: skip


class Attacker:
    """A client that knows the token and the callbacks of a server."""

    def __init__(self, folder, dropped):
        gmwm.simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=100.0, samples=1000, rng=1).write(folder / "a.csv")
        folders, first = open_path(folder / "a.csv", dropped)
        self.desk = Desk(folders, first)
        self.client = application(self.desk, host="127.0.0.1:5", token=TOKEN).test_client()
        self.data = {
            "session": first.to_dict(), "page": PAGE, "restored": 0, "revision": 0, "width": 1280, "time-unit": 1.0
        }  # fmt: skip
        assert self.client.get(f"/{TOKEN}/", base_url=BASE).status_code == 200
        listed = self.client.get(f"/{TOKEN}/_dash-dependencies", base_url=BASE).json
        self.callbacks = [entry for entry in listed if not entry.get("clientside_function")]

    def post(self, body):
        """Send a callback; return the status. An error inside the server is printed as a traceback."""
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        printed = io.StringIO()
        with contextlib.redirect_stderr(printed):
            answer = self.client.post(
                f"/{TOKEN}/_dash-update-component", data=data, headers={"Origin": BASE}, base_url=BASE,
                content_type="application/json",
            )  # fmt: skip
        assert "Traceback" not in printed.getvalue(), printed.getvalue()[-2000:]
        return answer.status_code

    def component(self, entry, tab):
        """Return the state of a component of the page, with a likely value."""
        name, prop = entry["id"], entry["property"]
        if name.startswith("{"):
            key = {k: v if isinstance(v, str) else KEYS.get(k, "x") for k, v in json.loads(name).items()}
            return [{"id": key, "property": prop, "value": _value("", prop)}]
        value = {**self.data, "tab": tab}.get(name) if prop == "data" else _value(name, prop)
        return {"id": name, "property": prop, "value": value}

    def request(self, callback, tab="model"):
        """Return the request that the page sends when the first input changes."""
        inputs, state = ([self.component(entry, tab) for entry in callback[kind]] for kind in ("inputs", "state"))
        first = inputs[0][0] if isinstance(inputs[0], list) else inputs[0]
        name = first["id"] if isinstance(first["id"], str) else json.dumps(first["id"], sort_keys=True).replace(" ", "")
        output = callback["output"]
        outputs = [
            dict(zip(("id", "property"), item.rpartition(".")[::2], strict=True))
            for item in output.strip(".").split("...")
        ]  # fmt: skip
        return {
            "output": output, "outputs": outputs if output.startswith("..") else outputs[0], "inputs": inputs,
            "state": state, "changedPropIds": [f"{name}.{first['property']}"],
        }  # fmt: skip


def _value(name, prop):
    if prop == "relayoutData":
        return {
            "shapes[0].xanchor": 0.1,
            "shapes[0].yanchor": 1e-3,
            "selections": [{"x0": 1, "x1": 5, "line": {"width": 2}}],
        }
    return VALUES.get(name, "") if prop == "value" else 1


@pytest.fixture(scope="module")
def attacker(tmp_path_factory):
    attacker = Attacker(tmp_path_factory.mktemp("opened"), tmp_path_factory.mktemp("dropped").resolve())
    yield attacker
    attacker.desk.close()


@pytest.mark.parametrize("tab", ["recording", "curves", "model", "numbers"])
def test_what_the_page_sends_is_answered(attacker, tab):
    for callback in attacker.callbacks:
        assert attacker.post(attacker.request(callback, tab)) in (200, 204), callback["output"]


def _places(value, path=()):
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from _places(item, (*path, key))


def _mutated(body, rng, values_only):
    places = [place for place in _places(body) if place and (not values_only or place[-1] == "value")]
    *above, last = places[rng.integers(len(places))] if places else (("inputs",))
    parent = body
    for key in above:
        parent = parent[key]
    if rng.random() < 0.1 and isinstance(parent, dict):
        del parent[last]
    else:
        parent[last] = json.loads(json.dumps(HOSTILE[rng.integers(len(HOSTILE))]))
    return body


@pytest.mark.parametrize("values_only", [False, True])
def test_a_forged_callback_is_refused_or_answered(attacker, values_only):
    statuses = set()
    for number in range(600):
        rng = np.random.default_rng([21, number])
        callback = attacker.callbacks[rng.integers(len(attacker.callbacks))]
        if callback["output"].startswith("..file.data"):
            continue  # a download waits for its calibration
        tab = ("recording", "curves", "model", "numbers", "download")[rng.integers(5)]
        statuses.add(attacker.post(_mutated(attacker.request(callback, tab), rng, values_only)))
    assert statuses == {200, 204, 400}


@pytest.mark.parametrize(
    "body",
    [b"", b"{", b"[]", b"null", b"[" * 50_000, b'{"a":' * 50_000, b"\xff\xfe", b'{"output":1e999}', b'"x"',
     b'{"output":' + b"9" * 10_000 + b"}", b'{"output":"fit.children"}', b'{"output":["x"]}'],
    ids=range(12),
)  # fmt: skip
def test_what_is_no_request_is_refused(attacker, body):
    assert attacker.post(body) == 400


def test_a_request_that_is_too_large_is_refused(attacker):
    assert attacker.post(b" " * (LARGEST_CALLBACK + 1)) == 413


@pytest.mark.parametrize("value", [10**30, -3, 3.01, "1", None, True, float("nan")])
def test_a_slider_stays_in_its_range(attacker, value):
    (callback,) = (entry for entry in attacker.callbacks if entry["inputs"][0]["id"] == "horizon")
    body = attacker.request(callback)
    body["inputs"][0]["value"] = value
    assert attacker.post(body) == 400
