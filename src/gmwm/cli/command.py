"""Decorator that turns a function that returns an Outcome into a shell command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Any, get_type_hints

from gmwm.base.extras import library
from gmwm.cli.options import AllRemarks, Json
from gmwm.cli.output import Outcome, collect_warnings, finish
from gmwm.cli.read_options import ReadOptionTexts
from gmwm.cli.settings import with_settings
from gmwm.recording.options import ReadOptions


def command(function: Callable[..., Outcome]) -> Callable[..., None]:
    """Turn a function that returns an Outcome into a shell command that prints it, as text or as JSON, writes its
    files, and prints warnings on stderr. A parameter of type `ReadOptions` becomes the options of `ReadOptionTexts`.
    The command also gets --all-remarks and, unless the function has a parameter `json`, --json."""
    hints = get_type_hints(function, include_extras=True)
    texts = get_type_hints(ReadOptionTexts, include_extras=True)
    parameters: list[Parameter] = []
    for declared in signature(function).parameters.values():
        if hints[declared.name] is ReadOptions:
            parameters += (
                Parameter(field.name, Parameter.KEYWORD_ONLY, default=field.default, annotation=texts[field.name])
                for field in fields(ReadOptionTexts)
            )
        else:
            parameters.append(declared.replace(kind=Parameter.KEYWORD_ONLY, annotation=hints[declared.name]))
    own_json = "json" in hints
    if not own_json:
        parameters.append(Parameter("json", Parameter.KEYWORD_ONLY, default=False, annotation=Json))
    parameters.append(Parameter("all_remarks", Parameter.KEYWORD_ONLY, default=False, annotation=AllRemarks))
    reads = next((name for name, hint in hints.items() if hint is ReadOptions), None)

    @wraps(function)
    def run(**declared: Any) -> None:
        json = declared["json"] if own_json else declared.pop("json")
        every = declared.pop("all_remarks")
        if declared.get("plot") is not None:
            library("matplotlib")  # before the work, which may take minutes
        with collect_warnings(every=every) as warned:
            if reads is not None:
                options = {field.name: declared.pop(field.name) for field in fields(ReadOptionTexts)}
                declared[reads] = ReadOptionTexts(**with_settings(options, Path.cwd())).parse()
            finish(function(**declared), warned, json=json, every=every)

    run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run
