"""Changes of files: bytes, lines of text, and parts of JSON documents."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

MOST_BYTES = 1 << 20
"""Largest size of a changed file (bytes)."""

_SIZES = (0, 1, 2, 127, 128, 255, 256, 32767, 65535, 1 << 20, (1 << 31) - 1, 1 << 31, (1 << 32) - 1, (1 << 63) - 1)
_TEXTS = (
    b"nan", b"inf", b"-1e308", b"1e999", b"1e17", b"NA", b"", b",", b";;", b"\t", b"\n", b"\r", b"\r\n", b'"', b"'",
    b"#", b"[", b"]" * 40, b"(", b" " * 300, b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"%", b"gyro_x", b"accel_z", b"time",
    b"[deg/s]", b"2024-02-30 25:61:61", b"23:59:60.5", b"-9223372036854775808", b"18446744073709551616", b"0x1F",
    b"1_000", b"1.000,5", b"sample rate: 0 Hz", b"sample rate: -1", b"=1+1", b"\x1b[2J", b"1e-320", b"0" * 400,
    b"True", b"None", b"{", b"}",
)  # fmt: skip


def changed_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    """Return a file with one to eight changes."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 9))):
        if not data:
            break
        _CHANGES[int(rng.integers(len(_CHANGES)))](data, rng)
    return bytes(data[:MOST_BYTES])


def _place(data: bytearray, rng: np.random.Generator) -> int:
    """Return a position, half of the time among the first 600 bytes, where headers are."""
    near = min(len(data), 600) if rng.random() < 0.5 else len(data)
    return int(rng.integers(near))


def _flip(data: bytearray, rng: np.random.Generator) -> None:
    data[_place(data, rng)] ^= 1 << int(rng.integers(8))


def _byte(data: bytearray, rng: np.random.Generator) -> None:
    data[_place(data, rng)] = int(rng.integers(256))


def _number(data: bytearray, rng: np.random.Generator) -> None:
    at, width = _place(data, rng), int(rng.choice([1, 2, 4, 8]))
    value = _SIZES[int(rng.integers(len(_SIZES)))] & ((1 << 8 * width) - 1)
    data[at : at + width] = value.to_bytes(width, "little" if rng.random() < 0.8 else "big")


def _float(data: bytearray, rng: np.random.Generator) -> None:
    at = _place(data, rng)
    value = rng.choice([np.nan, np.inf, -np.inf, 1e300, -1e300, 1e-310, 0.0, 1e17])
    data[at : at + 8] = np.float64(value).tobytes()


def _cut(data: bytearray, rng: np.random.Generator) -> None:
    del data[_place(data, rng) :]


def _remove(data: bytearray, rng: np.random.Generator) -> None:
    at = _place(data, rng)
    del data[at : at + int(rng.integers(1, 64))]


def _repeat(data: bytearray, rng: np.random.Generator) -> None:
    at = _place(data, rng)
    part = bytes(data[at : at + int(rng.integers(1, 400))])
    to = _place(data, rng)
    data[to:to] = part * int(rng.choice([1, 1, 1, 50]))


def _zeros(data: bytearray, rng: np.random.Generator) -> None:
    at, count = _place(data, rng), int(rng.integers(1, 600))
    data[at : at + count] = bytes(len(data[at : at + count]))


def _text(data: bytearray, rng: np.random.Generator) -> None:
    at = _place(data, rng)
    some = _TEXTS[int(rng.integers(len(_TEXTS)))]
    data[at : at + (len(some) if rng.random() < 0.5 else 0)] = some


def _swap(data: bytearray, rng: np.random.Generator) -> None:
    a, b, size = _place(data, rng), _place(data, rng), int(rng.integers(1, 64))
    one, two = bytes(data[a : a + size]), bytes(data[b : b + size])
    data[a : a + size], data[b : b + size] = two, one


def _cell(data: bytearray, rng: np.random.Generator) -> None:
    """Replace what stands between two separators."""
    at = _place(data, rng)
    ends = [k for k in (data.find(sign, at) for sign in b",;\t \n") if k >= 0]
    data[at : min(ends, default=at)] = _TEXTS[int(rng.integers(len(_TEXTS)))]


_CHANGES = (_flip, _flip, _byte, _number, _number, _float, _cut, _remove, _repeat, _zeros, _text, _text, _swap, _cell)


def changed_document(document: Any, rng: np.random.Generator) -> Any:
    """Return a JSON document with one to four changes: values of other types, other keys, other lengths."""
    made = copy.deepcopy(document)
    for _ in range(int(rng.integers(1, 5))):
        places = list(_places(made))
        holder, key = places[int(rng.integers(len(places)))]
        act = rng.random()
        if act < 0.25:
            del holder[key]
        elif act < 0.35 and isinstance(holder, dict):
            holder[f"{key}_"] = holder.pop(key)
        elif act < 0.45 and isinstance(holder, list):
            holder.append(copy.deepcopy(holder[key]))
        else:
            holder[key] = _value(holder[key], rng)
    return made


def _places(value: Any) -> Any:
    """Yield every place of a document: a list or an object, and an index or a key of it."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield value, key
        yield from _places(inner)


def _value(old: Any, rng: np.random.Generator) -> Any:
    """Return another value, half of the time of the same type."""
    if rng.random() < 0.5:
        if isinstance(old, bool):
            return not old
        if isinstance(old, int | float):
            return [0, -1, 1, 10**30, 1e308, 1e-308, -old, old * 2, old + 1][int(rng.integers(9))]
        if isinstance(old, str):
            return ["", "\0", "WN", "NaN", "Infinity", old[::-1], old + "x", "x" * 5000][int(rng.integers(8))]
    others = [None, True, 0, -1, 1.5, 1e400, "", "x", "NaN", [], [1], [[1]], [None], {}, {"a": 1}, {"a": {}}, 10**400]
    return others[int(rng.integers(len(others)))]
