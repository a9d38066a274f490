"""Tables of results and recordings for other libraries: Polars, pandas and xarray."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from polars import DataFrame


class Tabular(ABC):
    """Base of results and recordings that are tables."""

    coordinates: ClassVar[tuple[str, ...]] = ()
    """Columns that identify a row, which are the coordinates of a data set of xarray; without any, the row number."""

    @abstractmethod
    def to_polars(self) -> DataFrame:
        """Return the table as a data frame of Polars."""

    def to_pandas(self, *arguments: Any, **options: Any) -> Any:
        """Return the table as a data frame of pandas. The arguments are those of `to_polars`."""
        import pandas

        frame = self.to_polars(*arguments, **options)
        return pandas.DataFrame({column.name: column.to_numpy() for column in frame.get_columns()})

    def to_xarray(self, *arguments: Any, **options: Any) -> Any:
        """Return the table as a data set of xarray. The arguments are those of `to_polars`."""
        frame = self.to_pandas(*arguments, **options)
        return (frame.set_index(list(self.coordinates)) if self.coordinates else frame).to_xarray()
