"""Record the arguments of every kernel in a few small calibrations, so that hostile calls begin with good arguments."""

from __future__ import annotations

import pickle
import sys
import types
import warnings
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

MOST_CALLS, MOST_NUMBERS = 12, 40_000
"""Calls of a kernel that are kept, and numbers in the arrays of one."""
Calls = dict[str, list[tuple[tuple[Any, ...], int, tuple[str, ...]]]]
"""The arguments of each call of a kernel, how many of them have no name, and the names of the others."""


def _plain(value: Any) -> bool:
    """Return whether an argument can be written to a file."""
    if isinstance(value, tuple | list):
        return all(map(_plain, value))
    return value is None or isinstance(value, bool | int | float | str | np.ndarray)


def _copied(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.copy()
    return type(value)(map(_copied, value)) if isinstance(value, tuple | list) else value


def _record(calls: Calls, name: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> None:
    values = (*arguments, *named.values())
    size = sum(value.size for value in values if isinstance(value, np.ndarray))
    if len(calls[name]) < MOST_CALLS and size <= MOST_NUMBERS and _plain(values):
        calls[name].append((_copied(values), len(arguments), tuple(named)))


def _wrapped(calls: Calls, name: str, function: Any) -> Any:
    def call(*arguments: Any, **named: Any) -> Any:
        _record(calls, name, arguments, named)
        return function(*arguments, **named)

    return call


def _recording_class(calls: Calls, kind: type) -> type:
    """Return a subclass that records the arguments of its methods."""

    def create(self: Any, *arguments: Any, **named: Any) -> None:
        _record(calls, f"{kind.__name__}.__init__", arguments, named)
        kind.__init__(self, *arguments, **named)  # type: ignore[misc]

    def method(name: str) -> Any:
        def call(self: Any, *arguments: Any, **named: Any) -> Any:
            _record(calls, f"{kind.__name__}.{name}", arguments, named)
            return getattr(kind, name)(self, *arguments, **named)

        return call

    names = [name for name in vars(kind) if not name.startswith("_") and callable(getattr(kind, name))]
    return type(kind.__name__, (kind,), {"__init__": create, **{name: method(name) for name in names}})


def record(path: Path) -> None:
    """Calibrate small recordings with recording kernels, and write the arguments to a file. The package must not have
    been imported."""
    import importlib.util

    spec = importlib.util.find_spec("gmwm.base._core")
    assert spec is not None
    assert spec.loader is not None
    core = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(core)
    calls: Calls = defaultdict(list)
    module = types.ModuleType("gmwm.base._core")
    for name, value in vars(core).items():
        if name.startswith("_") or not callable(value):
            setattr(module, name, value)
        else:
            wrapped = _recording_class(calls, value) if isinstance(value, type) else _wrapped(calls, name, value)
            setattr(module, name, wrapped)
    sys.modules["gmwm.base._core"] = module
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _work()
    path.write_bytes(pickle.dumps(dict(calls)))


def _work() -> None:
    """Call most kernels."""
    import gmwm
    from gmwm.base.errors import GmwmError

    rng = np.random.default_rng(1)
    x = gmwm.Model.parse("GM(beta=1, sigma2=1) + WN(sigma2=1) + RW(gamma2=1e-5)").simulate(1500, 100.0, rng=1)
    spoilt = np.where(rng.random(1500) < 0.02, np.nan, x + 30 * (rng.random(1500) < 0.01))
    clean, gaps = gmwm.Signal(x, 100.0), gmwm.Signal.from_missing(spoilt, 100.0)
    imu = gmwm.Imu.from_arrays({"gyro_x": x, "gyro_y": np.round(x, 1)}, 100.0)

    def robust_accumulator() -> None:
        live = gmwm.WaveletAccumulator(rate=100.0, robust=True)
        live.update(x)
        live.result()

    tries = [lambda: gmwm.calibrate(imu, "WN + RW"), lambda: gmwm.inspect(imu), robust_accumulator]
    for model in ("2*GM + WN + RW", "ARMA(2, 1) + WN", "OSC + WN + FN", "MA(2)", "SARMA(1, 0, 1, 1, 12)"):
        tries += [
            lambda model=model: gmwm.fit(model, clean), lambda model=model: gmwm.fit(model, gaps, robust=True),
            lambda model=model: gmwm.fit(model, clean).model.simulate(2000, 100.0, rng=2),
        ]  # fmt: skip
    tries += [lambda: gmwm.fit_ml("GM + WN", gaps), lambda: gmwm.fit_ml("GM + WN", clean).smooth(clean)]
    for attempt in tries:
        try:
            attempt()
        except (GmwmError, AttributeError, NotImplementedError):
            continue  # not every model has every method


if __name__ == "__main__":
    record(Path(sys.argv[1]))
