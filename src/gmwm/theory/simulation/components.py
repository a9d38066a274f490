"""Simulated signals and recordings with their latent processes."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from gmwm.base.errors import DataError
from gmwm.base.plotting import Plotted
from gmwm.recording.signals import Imu, Signal
from gmwm.recording.writers import write_table
from gmwm.theory.processes.model import Model


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SimulatedSignal(Plotted):
    """Simulated signal X_t = offset + Σ_k X_t^(k), with the latent process X^(k) of each term k of the model.

    Parameters
    ----------
    signal : Signal
        The signal X.
    components : mapping of term to Signal
        The latent processes by the names of `model.terms`, in the order in which they were added. If `resolution` is
        None, `offset + sum(path.values for path in components.values())` equals `signal.values` to the last bit.
    model : Model
        The model with its values.
    offset : float
        Gravity or 0, in the unit of the signal; it was added to the noise.
    resolution : float or None
        The step of the rounded signal, in the unit of the signal; None if it is not rounded. The latent processes are
        not rounded, so their sum agrees with the signal within half a step.
    """

    signal: Signal
    components: Mapping[str, Signal]
    model: Model
    offset: float = 0.0
    resolution: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "components", MappingProxyType(dict(self.components)))

    def __reduce__(self) -> tuple[Any, ...]:
        # A mapping proxy cannot be pickled, so the copy is made from a dict.
        build = partial(
            SimulatedSignal, signal=self.signal, components=dict(self.components), model=self.model, offset=self.offset,
            resolution=self.resolution,
        )  # fmt: skip
        return build, ()

    def __getitem__(self, term: str) -> Signal:
        try:
            return self.components[term]
        except KeyError:
            raise DataError(argument="term", expected=f"one of {', '.join(self.model.terms)}", got=term) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.components)

    def __repr__(self) -> str:
        return f"SimulatedSignal({self.signal!r} = {' + '.join(self.model.terms)})"

    def write_components(self, path: str | os.PathLike[str]) -> tuple[str, ...]:
        """Write the latent processes as a table with one column each.

        The columns are `time [s]` and one for each term, such as `gyro_x WN [rad/s]`, with full precision.
        `gmwm.read(path, columns={"gyro_x": "gyro_x WN [rad/s]"})` reads one of them. If writing fails, no file
        remains.

        Parameters
        ----------
        path : path
            File to write, ending in .csv or .parquet.

        Returns
        -------
        tuple of str
            Names of the columns after the time.

        Raises
        ------
        OptionError
            If the path has another ending.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> from gmwm import simulate_signal
        >>> folder = tempfile.TemporaryDirectory()
        >>> simulated = simulate_signal("WN(sigma2=1) + RW(gamma2=0.01)", rate=10.0, samples=100, rng=1, unit="m")
        >>> simulated.write_components(pathlib.Path(folder.name, "parts.csv"))
        ('RW [m]', 'WN [m]')
        >>> folder.cleanup()
        """
        return _write_components([self], path)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SimulatedImu:
    """A simulated recording with the latent processes of each axis.

    Parameters
    ----------
    imu : Imu
        The recording.
    axes : mapping of axis to SimulatedSignal
        Each axis with its latent processes; `simulated["gyro_x"]` is the same as `simulated.axes["gyro_x"]`.
    """

    imu: Imu
    axes: Mapping[str, SimulatedSignal]

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", MappingProxyType(dict(self.axes)))

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(SimulatedImu, imu=self.imu, axes=dict(self.axes)), ()

    @property
    def components(self) -> dict[str, Mapping[str, Signal]]:
        """The latent processes by axis and term: `components["gyro_x"]["WN"]`."""
        return {axis: simulated.components for axis, simulated in self.axes.items()}

    def __getitem__(self, axis: str) -> SimulatedSignal:
        try:
            return self.axes[axis]
        except KeyError:
            raise DataError(argument="axis", expected=f"one of {', '.join(self.axes)}", got=axis) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.axes)

    def __repr__(self) -> str:
        parts = "; ".join(f"{axis} = {' + '.join(signal.model.terms)}" for axis, signal in self.axes.items())
        return f"SimulatedImu({self.imu!r}; {parts})"

    def write_components(self, path: str | os.PathLike[str]) -> tuple[str, ...]:
        """Write the latent processes of all axes to the file `path`; see `SimulatedSignal.write_components`."""
        return _write_components(list(self.axes.values()), path)


def _write_components(parts: Sequence[SimulatedSignal], path: str | os.PathLike[str]) -> tuple[str, ...]:
    """Write the latent processes of several signals as one table. Return the names of the columns after the time."""
    columns = {}
    for part in parts:
        for component in part.components.values():
            unit = f" [{component.unit}]" if component.unit else ""
            columns[f"{component.axis}{unit}"] = component.values
    write_table({"time [s]": parts[0].signal.times(), **columns}, path)
    return tuple(columns)
