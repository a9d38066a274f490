"""Decorator of shell commands, and settings of options in `gmwm.toml` or [tool.gmwm] of `pyproject.toml`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from functools import wraps
from importlib.util import LazyLoader, find_spec, module_from_spec
from inspect import Parameter, Signature, get_annotations, getdoc, signature
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

from typer.models import ArgumentInfo, OptionInfo

from gmwm.base.errors import GmwmError, OptionError, ReadError
from gmwm.base.extras import library
from gmwm.base.lazy import tomllib
from gmwm.base.template import shell_option
from gmwm.base.text import counted
from gmwm.cli.options import SHARED, option_texts
from gmwm.cli.output import Outcome, collect_warnings, finish
from gmwm.cli.read_options import ReadOptionTexts
from gmwm.recording.options import ReadOptions

OPTIONS = ("rate", "units", "columns", "scale", "increments", "mount", "format", "topic")
"""Options that describe the files of a logger. All others belong to one recording or one run."""


def with_settings(options: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return options, missing ones from settings of a folder or the next above with settings, stated on stderr."""
    path, settings = find_settings(folder)
    used = {name: value for name, value in settings.items() if options.get(name, value) is None}
    if used:
        texts = ", ".join(f"--{name} {value}" for name, value in used.items())
        print(f"note: {counted(len(used), 'option')} of {path}: {texts}", file=sys.stderr)
    return {**options, **used}


def find_settings(folder: Path) -> tuple[Path | None, dict[str, Any]]:
    """Return the path and the content of the settings of a folder, or of the next folder above it that has settings."""
    for place in (folder, *folder.parents):
        for path, table in ((place / "gmwm.toml", ()), (place / "pyproject.toml", ("tool", "gmwm"))):
            if path.is_file():
                content: Any = _toml(path, required=not table)
                for key in table:
                    content = content.get(key, {}) if isinstance(content, Mapping) else {}
                if content or not table:
                    return path, _checked(path, content)
    return None, {}


def _toml(path: Path, *, required: bool) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            return tomllib.load(file)
    except (OSError, ValueError) as error:
        if not required:  # the file of another program
            return {}
        raise ReadError(f"{path} is not TOML: {error}", advice="Correct the file.") from error


def _checked(path: Path, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values as a command line has them: lists and tables become texts."""
    unknown = [name for name in content if name not in OPTIONS]
    if unknown:
        raise OptionError(f"{path} has the unknown key {unknown[0]!r}", advice=f"The keys are {', '.join(OPTIONS)}.")
    rate = content.get("rate", 1.0)
    if not isinstance(rate, int | float) or isinstance(rate, bool):
        raise OptionError(f"{path}: rate must be a number in Hz; got {rate!r}")
    return {name: float(value) if name == "rate" else _text(value) for name, value in content.items()}


def _text(value: Any) -> str:
    """Return a value as the text of an option.

    >>> _text({"gyro": "deg/s", "accel": "g"}), _text(["time", "gyro_x"])
    ('gyro=deg/s,accel=g', 'time,gyro_x')
    """
    if isinstance(value, Mapping):
        return ",".join(f"{key}={item}" for key, item in value.items())
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)


def command(function: Callable[..., Outcome]) -> Callable[..., None]:
    """Turn a function that returns an Outcome into a shell command that prints it, writes its files, and prints
    warnings on stderr. `ReadOptions` become those of `ReadOptionTexts`; --all-remarks and --json are added. Texts of
    the parameters are in the docstring or in `SHARED`, unless a type has an option of Typer."""
    description, own = option_texts(getdoc(function) or "")
    texts = option_texts(SHARED)[1] | own
    # In Python 3.10, get_type_hints puts the types of parameters whose default is None into Optional.
    hints, read_hints = get_annotations(function, eval_str=True), get_annotations(ReadOptionTexts, eval_str=True)
    declared: dict[str, tuple[Any, Any]] = {}  # type and default of each parameter
    for parameter in signature(function).parameters.values():
        if hints[parameter.name] is ReadOptions:
            declared |= {field.name: (read_hints[field.name], field.default) for field in fields(ReadOptionTexts)}
        else:
            declared[parameter.name] = hints[parameter.name], parameter.default
    own_json = "json" in declared
    declared |= {"json": declared.get("json", (bool, False)), "all_remarks": (bool, False)}
    parameters = [
        Parameter(
            name, Parameter.KEYWORD_ONLY, default=default,
            annotation=hint if get_origin(hint) is Annotated else texts[name].annotate(name, hint),
        )
        for name, (hint, default) in declared.items()
    ]  # fmt: skip
    reads = next((name for name, hint in hints.items() if hint is ReadOptions), None)
    names = {parameter.name: _shell_name(parameter) for parameter in parameters}

    @wraps(function)
    def run(**values: Any) -> None:
        _spare_libraries()
        json = values["json"] if own_json else values.pop("json")
        every = values.pop("all_remarks")
        if values.get("plot") is not None:
            library("matplotlib")  # before the work, which may take minutes
        with collect_warnings(every=every) as warned, _named_by(names, dict(values)):
            if reads is not None:
                options = {field.name: values.pop(field.name) for field in fields(ReadOptionTexts)}
                values[reads] = ReadOptionTexts(**with_settings(options, Path.cwd())).parse()
            finish(function(**values), warned, json=json, every=every)

    run.__doc__ = description
    run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def _spare_libraries() -> None:
    """Load packages only if they are used: SciPy asks for all of NumPy, and its optimisers for spatial trees,
    which takes a third of the time of their import."""
    for path in ("numpy.ctypeslib", "numpy.f2py", "numpy.ma", "numpy.testing", "scipy.spatial"):
        if path not in sys.modules and (spec := find_spec(path)) and spec.loader:
            spec.loader = LazyLoader(spec.loader)
            sys.modules[path] = module = module_from_spec(spec)
            spec.loader.exec_module(module)
            package, _, name = path.rpartition(".")
            setattr(sys.modules[package], name, module)


def _shell_name(parameter: Parameter) -> str:
    """Return the option of a parameter, or the name of the argument in the usage of the command."""
    infos = (item for item in get_args(parameter.annotation) if isinstance(item, ArgumentInfo | OptionInfo))
    info = next(infos, None)
    if isinstance(info, ArgumentInfo):
        return (info.metavar or parameter.name.upper()).strip("[].")
    # Typer takes the first name of an option in `Annotated` for its default.
    texts = (getattr(info, "default", None), *(getattr(info, "param_decls", None) or ()))
    options = [text.partition("/")[0] for text in texts if isinstance(text, str) and text.startswith("--")]
    usual = f"--{parameter.name.replace('_', '-')}"
    return usual if usual in options or not options else options[0]


@contextmanager
def _named_by(names: Mapping[str, str], given: Mapping[str, Any]) -> Iterator[None]:
    """Make errors in the block name the options and the arguments of a command, whose values are `given`.

    An argument of the library that is none of the command, such as `path`, is the one that has the value of the error.
    """
    try:
        yield
    except GmwmError as error:
        options = {**names, **error.options}
        for name in {error.argument or "", error.prefix} - {"", *options}:
            if shell_option(name) not in names.values():
                same = (names[other] for other, value in given.items() if _is_value(value, error.got))
                options[name] = next(same, name)
        error.options = options
        raise


def _is_value(value: Any, got: object) -> bool:
    """Return whether the path of an option, or one of its paths, is that of an error."""
    if isinstance(value, list | tuple):
        return any(_is_value(item, got) for item in value)
    return isinstance(value, Path) and isinstance(got, str) and value.name == Path(got).name
