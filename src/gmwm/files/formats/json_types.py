"""Decode JSON objects to columns of numbers.

A field has the name of its path, such as `gyro.x` or `acc[0]`. A time stamp in two fields, sec and nsec, is one number
in nanoseconds.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadError
from gmwm.files.clock.lost_samples import MISSING

if TYPE_CHECKING:
    import polars as pl

_STAMP = re.compile(r"(.*)\.(?:sec|secs|seconds)")
_FRACTIONS = ("nsec", "nsecs", "nanosec", "nanosecs", "nanos", "nanoseconds")
_ELEMENTS = 9  # numbers of a list that become columns, as in a covariance


@dataclass(frozen=True)
class JsonType:
    """The type of JSON messages, by their fields."""

    schema: pl.Schema
    elements: int  # number of elements of each list that are columns

    @classmethod
    def of(cls, messages: Sequence[bytes], name: object) -> JsonType:
        """Return the type of the first messages of `name`: float64 for numbers of at most 15 digits."""
        import polars as pl

        messages = [message.replace(b"\n", b" ") for message in messages if is_object(message)]
        try:
            schema = pl.read_ndjson(BytesIO(b"\n".join(messages)), infer_schema_length=None).schema
        except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
            raise ReadError(
                f"{name} holds no JSON objects ({str(error).splitlines()[0]})", code="no-numbers",
                advice="Write one object for each sample, in a line of its own.",
            ) from error  # fmt: skip
        long = re.search(rb"(?<![\d.])\d{16,19}(?![\d.])", b"\n".join(messages[:10])) is not None
        lists = re.findall(rb"\[([^\[\]{}]*)\]", b" ".join(messages[:10]))
        elements = min(max((part.count(b",") + 1 for part in lists), default=0), _ELEMENTS)
        return cls(pl.Schema({name: _plain(kind, long) for name, kind in schema.items()}), elements)

    def leaves(self) -> tuple[str, ...]:
        """Return the names of the numbers in every message."""
        import polars as pl

        columns = _flat(pl.DataFrame(schema=self.schema), self.elements).schema.items()
        return tuple(name for name, kind in columns if kind.is_numeric())

    def decoder(self, wanted: Sequence[str]) -> JsonDecoder:
        """Return a decoder of some numbers."""
        return JsonDecoder(self, wanted)

    def table(self, lines: Sequence[bytes]) -> pl.DataFrame:
        """Return the fields of messages as columns."""
        import polars as pl

        return _flat(pl.read_ndjson(BytesIO(b"\n".join(lines)), schema=self.schema, ignore_errors=True), self.elements)


@dataclass(frozen=True)
class JsonDecoder:
    """Decoder of the wanted numbers of JSON messages."""

    type: JsonType
    wanted: Sequence[str]

    def decode(self, messages: Sequence[bytes]) -> dict[str, NDArray[Any]]:
        """Return the wanted numbers of messages; NaN or `MISSING` where a message lacks one."""
        import polars as pl

        try:
            table = self.type.table([message.replace(b"\n", b" ") for message in messages])
        except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
            raise ReadError(
                f"a message is not JSON ({str(error).splitlines()[0]})", code="message-damaged",
                advice="Copy the file again.",
            ) from error  # fmt: skip
        columns = {name: table.get_column(name) for name in self.wanted}
        return {
            name: np.ascontiguousarray(
                (column.fill_null(MISSING) if column.dtype.is_integer() else column.cast(pl.Float64)).to_numpy()
            )
            for name, column in columns.items()
        }


def is_object(message: bytes) -> bool:
    """Return whether a message is a JSON object."""
    try:
        return isinstance(json.loads(message), dict)
    except (ValueError, RecursionError):
        return False


def _plain(kind: Any, long: bool) -> Any:
    """Return the type with which a field is read."""
    import polars as pl

    if isinstance(kind, pl.Struct):
        return pl.Struct({field.name: _plain(field.dtype, long) for field in kind.fields})
    if isinstance(kind, pl.List):
        return pl.List(_plain(kind.inner, long))
    return kind if (long and kind == pl.Int64) or not kind.is_numeric() else pl.Float64


def _flat(table: pl.DataFrame, elements: int) -> pl.DataFrame:
    """Return a table in which each field of an object and each element of a short list is a column."""
    import polars as pl

    columns: list[pl.Series] = []
    for column in table.get_columns():
        kind = column.dtype
        if isinstance(kind, pl.Struct):
            inner = column.struct.unnest() if kind.fields else pl.DataFrame()
            columns += _flat(
                inner.rename({name: f"{column.name}.{name}" for name in inner.columns}), elements
            ).get_columns()
        elif isinstance(kind, pl.List) and kind.inner.is_numeric():
            columns += [column.list.get(k, null_on_oob=True).alias(f"{column.name}[{k}]") for k in range(elements)]
        elif not isinstance(kind, pl.List):
            columns.append(column)
    flat = pl.DataFrame(columns)
    for name in flat.columns:
        stamp = _STAMP.fullmatch(name)
        fractions = [f"{stamp[1]}.{word}" for word in _FRACTIONS] if stamp else []
        fraction = next((column for column in fractions if column in flat.columns), "")
        if stamp and fraction:
            stamp_name = stamp[1] if stamp[1].endswith("header.stamp") else f"{stamp[1]}_ns"
            time = pl.col(name).cast(pl.Int64) * 10**9 + pl.col(fraction).cast(pl.Int64)
            flat = flat.select(time.alias(stamp_name), pl.exclude(name, fraction))
    return flat
