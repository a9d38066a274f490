"""JSON Schemas of what commands print; the fixture `gmwm` holds every JSON of these tests against them."""

import copy
import json

import jsonschema
import pytest

from gmwm.cli.main import NAMES, schema
from gmwm.cli.main import SCHEMAS as FILE
from tests.helpers import each
from tests.json_outputs import Shape

SCHEMAS = json.loads(FILE.read_text(encoding="utf-8"))
WITHOUT = {"app"}
"""The app prints no JSON."""


def test_every_command_has_a_schema():
    assert set(NAMES) - WITHOUT == {name for name in SCHEMAS if not name.endswith("-event")}


@pytest.mark.slow
@each("name", ["calibration.json", "session.json", *SCHEMAS])
def test_the_schema_is_one_and_is_printed(gmwm, name):
    jsonschema.Draft202012Validator.check_schema(schema(name))
    assert json.loads(gmwm("--schema", name).out) == schema(name)


def test_an_unknown_name_is_an_error_that_lists_the_names(gmwm):
    gmwm("--schema", "fitt").require_refusal("calibration.json", "monitor-event")


def test_another_type_or_a_missing_key_is_refused(gmwm, recording):
    document = gmwm("wv", recording, "--axis", "gyro_x", "--json").json
    validator = jsonschema.Draft202012Validator(schema("wv"))
    assert validator.is_valid(document)
    for path, value in [(("axes",), []), (("gmwm",), 1), (("axes", "gyro_x", "variance", 0), "x"), (("file",), ...)]:
        changed = copy.deepcopy(document)
        *above, key = path
        place = changed
        for step in above:
            place = place[step]
        if value is ...:
            del place[key]
        else:
            place[key] = value
        assert not validator.is_valid(changed), path


def test_a_schema_is_that_of_what_was_seen():
    shape = Shape()
    for rate, extra in ((100.0, {}), (1, {"note": None})):
        shape.add({"rate": rate, "axes": {"gyro_x": {"low": 1.0}, "lever": {"low": 2.0, "high": 3.0}}, **extra})
    assert shape.schema() == {
        "type": "object",
        "properties": {
            "rate": {"type": ["null", "number"]},
            "axes": {
                "type": "object",
                "additionalProperties": {
                    "type": "object",
                    "properties": {"low": {"type": ["null", "number"]}, "high": {"type": ["null", "number"]}},
                    "required": ["low"],
                },
            },
            "note": {},
        },
        "required": ["rate", "axes"],
    }
