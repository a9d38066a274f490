"""The choices of a user as a small JSON document, and the commands and code that compute the same results."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from gmwm.base.documents import DIALECT, Schemas
from gmwm.base.errors import GmwmError, OptionError, ReadError
from gmwm.base.kinds import Document, field_types, require_kinds
from gmwm.base.template import shell_word
from gmwm.calibration.options import CalibrationOptions
from gmwm.choosing.datasheets.effective import DEFAULT_HORIZON_S
from gmwm.files.readers.streams import is_large
from gmwm.recording.options import ReadOptions, one_of
from gmwm.showing.exporters import export_formats
from gmwm.showing.exporters.reduction import Rule
from gmwm.showing.plots.labels import UnitSystem, ViewName

if TYPE_CHECKING:
    from typing_extensions import Self


FORMAT = "gmwm-session"
LONGEST = 1_000_000  # largest length of a session
_DOCUMENT = Document("session", "Save it again with the button session.json of the app.")
VERSION = 1  # Version of the format. gmwm reads only this version.
READING = tuple(field.name for field in fields(ReadOptions))
Curve = Literal["classical", "robust", "both"]  # which estimates of the wavelet variance the tab "Curves" shows

_ALLOWED: Mapping[str, Sequence[str]] = {
    "curve": get_args(Curve),
    "view": get_args(ViewName),
    "units": get_args(UnitSystem),
    "export": list(export_formats()),
}


@dataclass(frozen=True, kw_only=True)
class Session:
    """The choices of a user of the page. All values are checked on construction.

    >>> Session(file="static.csv", reading={"skip": [[10, 20]]}).to_dict()
    {'file': 'static.csv', 'reading': {'skip': [[10.0, 20.0]]}}
    """

    file: str = ""  # path of the recording; "" if none is open
    reading: Mapping[str, Any] = field(default_factory=dict)  # options of `gmwm.read` that differ from their defaults
    axis: str = ""  # the axis whose model is shown
    robust: Literal["auto"] | bool = "auto"
    models: Mapping[str, str] = field(default_factory=dict)  # models that the user chose, with held values, by axis
    confidence: float = 0.95
    curve: Curve = "classical"
    view: ViewName = "allan"
    units: UnitSystem = "datasheet"
    rule: Rule | None = None  # how the exported file combines the axes of a sensor; None for the rule of the format
    inflation: float = 1.0
    horizon: float = DEFAULT_HORIZON_S  # time between corrections from other sensors (s)
    export: str = "kalibr"  # format of the exported file
    reference: Mapping[str, str] = field(default_factory=dict)  # of the manufacturer, such as {"gyro.N": "2.0 deg/√h"}
    duration: float = 60.0  # time of unaided navigation in the error budget (s)

    def __post_init__(self) -> None:
        object.__setattr__(self, "reading", self.options.to_dict())
        object.__setattr__(self, "models", {axis: str(model) for axis, model in self.calibration.models.items()})
        for name, allowed in _ALLOWED.items():
            one_of(getattr(self, name), name, allowed)
        if self.rule is not None:
            one_of(self.rule, "rule", get_args(Rule))
        for name in ("inflation", "horizon", "duration"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1e300:
                raise OptionError(argument=name, expected="a positive number", got=value)
            object.__setattr__(self, name, float(value))

    @property
    def options(self) -> ReadOptions:
        """Options for reading the file, from `reading`."""
        unknown = next((name for name in self.reading if name not in READING), None)
        if unknown is not None:
            raise _DOCUMENT.error(f"the option {unknown!r} for reading is unknown")
        return ReadOptions(**self.reading)

    @property
    def calibration(self) -> CalibrationOptions:
        """Options of the calibration, from `robust`, `confidence` and `models`."""
        return CalibrationOptions(robust=self.robust, confidence=self.confidence, models=self.models)

    def with_(self, **values: Any) -> Session:
        """Return a copy of the session with some values replaced."""
        return replace(self, **values)

    def read_as(self, **values: Any) -> Session:
        """Return a copy of the session with some options for reading replaced. The value None removes an option."""
        reading = {**self.reading, **values}
        return replace(self, reading={name: value for name, value in reading.items() if value not in (None, "", {})})

    def with_model(self, axis: str, model: str | None) -> Session:
        """Return a copy of the session with another model of an axis. If the model is None, gmwm chooses it."""
        models = {name: text for name, text in self.models.items() if name != axis}
        return replace(self, models=models if model is None else {**models, axis: model})

    def to_dict(self) -> dict[str, Any]:
        """Return the values that differ from their defaults, as plain values for JSON."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        changed = {name: value for name, value in values.items() if value != getattr(EMPTY, name)}
        return {name: dict(value) if isinstance(value, Mapping) else value for name, value in changed.items()}

    def to_text(self) -> str:
        """Return the session as the text of session.json."""
        content = {"format": FORMAT, "version": VERSION, **self.to_dict()}
        return json.dumps(content, ensure_ascii=False, indent=1) + "\n"

    @classmethod
    def schema(cls) -> dict[str, Any]:
        """Return the JSON Schema (draft 2020-12) of session.json. A key that is absent has its default."""
        schemas = Schemas({"type": "number"})
        reading, session = (
            {name: schemas.of(kind) for name, kind in field_types(part).items()} for part in (ReadOptions, cls)
        )
        named = {"format": {"const": FORMAT}, "version": {"const": VERSION}}
        options = {"type": "object", "properties": reading, "additionalProperties": False}
        return {
            "$schema": DIALECT, "title": FORMAT, "type": "object", "required": [*named], "additionalProperties": False,
            "properties": {**named, **session, "reading": options}, "$defs": schemas.by_name,
        }  # fmt: skip

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Self:
        """Restore a session from the result of `to_dict`."""
        names = [field.name for field in fields(cls)]
        unknown = next((name for name in content if name not in names), None)
        if unknown is not None:
            raise ReadError(f"not a session: the key {unknown!r} is unknown", code="unsupported")
        if len(str(content)) > LONGEST:
            raise _DOCUMENT.error(f"it has more than {LONGEST} characters")
        try:
            session = cls(**content)
        except GmwmError:
            raise
        except (TypeError, ValueError, AttributeError, ArithmeticError, LookupError) as error:
            raise _DOCUMENT.error(str(error)) from error
        require_kinds(session, "", _DOCUMENT)
        return session

    @classmethod
    def load(cls, path: Path) -> Self:
        """Restore a session from a session.json."""
        try:
            return cls.from_text(path.read_text(encoding="utf-8"))
        except UnicodeDecodeError as error:
            raise ReadError(f"not a session: it is not text in UTF-8 ({error.reason})", code="not-text") from error

    @classmethod
    def from_text(cls, text: str) -> Self:
        """Restore a session from the text of a session.json."""
        try:
            content = json.loads(text) if len(text) <= LONGEST else None
        except (ValueError, RecursionError) as error:
            raise ReadError(f"not a session: it is not JSON ({error})", code="not-text") from error
        if not isinstance(content, dict) or content.pop("format", None) != FORMAT:
            raise ReadError(f'not a session: it has no "format": "{FORMAT}"', code="wrong-format")
        version = content.pop("version", None)
        if version != VERSION:
            raise ReadError(
                f"the session has version {version!r} of the format; this gmwm reads version {VERSION}",
                code="unsupported",
            )
        return cls.from_dict(content)


EMPTY = Session()  # a session without a recording


FOLDER = "results"  # folder for results in the commands


def shell_lines(session: Session) -> list[str]:
    """Return the shell commands that write the files of the tab "Download".

    >>> print("\\n".join(shell_lines(Session(file="static.csv", reading={"skip": [[10, 20]]}))))
    gmwm calibrate static.csv --skip 10-20 --output results
    gmwm export results/calibration.json --format kalibr --output imu.yaml
    """
    calibrate = ["gmwm", "calibrate", session.file, *_reading(session.reading)]
    for axis, model in session.models.items():
        calibrate += ["--model", f"{axis}={model}"]
    if session.robust != EMPTY.robust:
        calibrate += ["--robust", "yes" if session.robust else "no"]
    if session.confidence != EMPTY.confidence:
        calibrate += ["--confidence", number(session.confidence)]
    calibrate += ["--output", FOLDER]
    export = ["gmwm", "export", f"{FOLDER}/calibration.json", "--format", session.export]
    if session.rule is not None:
        export += ["--axes", session.rule]
    if session.inflation != EMPTY.inflation:
        export += ["--inflation", number(session.inflation)]
    if session.horizon != EMPTY.horizon:
        export += ["--horizon", f"{number(session.horizon)}s"]
    export += ["--output", file_name(session)]
    return [" ".join(map(shell_word, words)) for words in (calibrate, export)]


def python_lines(session: Session) -> list[str]:
    """Return the lines of Python code that write the files of the tab "Download".

    >>> print("\\n".join(python_lines(Session(file="static.csv", models={"gyro": "GM + WN"}))))
    import gmwm
    <BLANKLINE>
    imu = gmwm.read('static.csv')
    calibration = gmwm.calibrate(imu, models={'gyro': 'GM + WN'}).of_file('static.csv')
    calibration.save('calibration.json')
    calibration.report('report.html')
    calibration.export('imu.yaml', 'kalibr')
    """
    options: dict[str, Any] = {"robust": session.robust, "confidence": session.confidence, "models": session.models}
    changed = {name: value for name, value in options.items() if value != getattr(EMPTY, name)}
    export: dict[str, Any] = {"axes": session.rule, "inflation": session.inflation, "horizon": session.horizon}
    defaults = {"axes": EMPTY.rule, "inflation": EMPTY.inflation, "horizon": EMPTY.horizon}
    chosen = {name: value for name, value in export.items() if value != defaults[name]}
    opened = "stream" if is_large(Path(session.file)) else "read"
    return [
        "import gmwm",
        "",
        f"imu = gmwm.{opened}({_call(session.file, **session.reading)})",
        f"calibration = gmwm.calibrate({_call(**changed, first='imu')}).of_file({session.file!r})",
        "calibration.save('calibration.json')",
        "calibration.report('report.html')",
        f"calibration.export({_call(file_name(session), session.export, **chosen)})",
    ]


def file_name(session: Session) -> str:
    """Return the name of the exported file in the format of a session.

    >>> file_name(Session()), file_name(Session(export="openvins"))
    ('imu.yaml', 'openvins.yaml')
    """
    from gmwm.showing.exporters.base import find_exporter

    return f"{'imu' if session.export == EMPTY.export else session.export}{find_exporter(session.export).extension}"


def number(value: float) -> str:
    """Format a number with all digits, but a whole number without a decimal point.

    >>> number(20.0), number(0.1)
    ('20', '0.1')
    """
    return repr(int(value)) if float(value).is_integer() and abs(value) < 1e15 else repr(float(value))


def _call(*values: Any, first: str = "", **named: Any) -> str:
    """Format the arguments of a Python call. `first` is an argument that is already code."""
    return ", ".join([*([first] if first else []), *map(repr, values), *(f"{k}={v!r}" for k, v in named.items())])


def _reading(reading: Mapping[str, Any]) -> Iterator[str]:
    """Yield the words of the shell options for reading a recording."""
    for name, value in reading.items():
        option = f"--{name.replace('_', '-')}"
        if name == "skip":
            for begin, end in value:
                yield from (option, f"{number(begin)}-{number(end)}")
        elif name == "columns":
            yield from (option, _columns(value))
        elif isinstance(value, Mapping):
            pairs = (f"{k}={number(v) if isinstance(v, float) else v}" for k, v in value.items())
            yield from (option, ",".join(pairs))
        elif isinstance(value, list):
            yield from (option, ",".join(value))
        else:
            yield from (option, number(value) if isinstance(value, float) else str(value))


def _columns(columns: Any) -> str:
    if isinstance(columns, Mapping):
        return ",".join(f"{axis}={'' if column is None else column}" for axis, column in columns.items())
    return ",".join(axis or "" for axis in columns)
