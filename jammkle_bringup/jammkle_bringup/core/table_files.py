"""Tables on disk, written in parts as they come: CSV or Parquet, by Apache Arrow."""

from __future__ import annotations

import contextlib
import enum
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol

import pyarrow as pa  # type: ignore[import-untyped]  # carries no types
import pyarrow.csv  # type: ignore[import-untyped]  # carries no types
import pyarrow.parquet  # type: ignore[import-untyped]  # carries no types

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

PART_ROWS = 16_384
"""Rows that are held before they are written."""


class TableFormat(enum.Enum):
    """What a table is written as; the value is the end of its file's name."""

    CSV = "csv"
    PARQUET = "parquet"


class _Writer(Protocol):
    def write_table(self, table: Any) -> None: ...

    def close(self) -> None: ...


class NewColumnError(Exception):
    """A column came up after the head of the table was written; `columns` are all that are known now."""

    def __init__(self, columns: list[str]) -> None:
        """Keep the columns."""
        super().__init__(", ".join(columns))
        self.columns = columns


class TableFile:
    """One table that is being written. Columns are those of the rows before the first part is written."""

    def __init__(self, path: Path, form: TableFormat, columns: Sequence[str]) -> None:
        """Begin a table; the file is made with its first part.

        Args:
            path: The file; written over.
            form: As what.
            columns: Known by now, in order.

        """
        self.path = path
        self.rows = 0
        self._form = form
        self._columns = {name: place for place, name in enumerate(columns)}
        self._held: list[dict[str, Any]] = []
        self._schema: Any = None
        self._writer: _Writer | None = None
        self._file: BinaryIO | None = None

    @property
    def columns(self) -> list[str]:
        """Names of the columns, in order."""
        return list(self._columns)

    def add(self, row: dict[str, Any]) -> None:
        """Take a row; what it lacks is empty.

        Raises:
            NewColumnError: it has a column that the head of the table lacks.
            OSError: it cannot be written.

        """
        if not row.keys() <= self._columns.keys():
            self._columns.update({name: len(self._columns) for name in row if name not in self._columns})
            if self._schema is not None:
                raise NewColumnError(self.columns)
        self._held.append(row)
        if len(self._held) >= PART_ROWS:
            self._write()

    def close(self) -> None:
        """Write what is held, and end the file.

        Raises:
            OSError: it cannot be written.

        """
        if self._held or self._writer is None:
            self._write()
        self._end()

    def abandon(self) -> None:
        """End the file as it is."""
        self._held.clear()
        self._end()

    def _end(self) -> None:
        with contextlib.ExitStack() as stack:
            if self._file is not None:
                stack.callback(self._file.close)
            if self._writer is not None:
                self._writer.close()

    def _write(self) -> None:
        if self._schema is None:
            arrays = [pa.array([row.get(name) for row in self._held]) for name in self._columns]
            self._schema = pa.schema(
                [
                    pa.field(name, pa.float64() if pa.types.is_null(array.type) else array.type)
                    for name, array in zip(self._columns, arrays, strict=True)
                ]
            )
            self._writer = self._opened()
        table = pa.table(
            [pa.array([row.get(field.name) for row in self._held], field.type) for field in self._schema],
            schema=self._schema,
        )
        if self._writer is not None:
            self._writer.write_table(table)
        self.rows += len(self._held)
        self._held.clear()

    def _opened(self) -> _Writer:
        self._file = self.path.open("wb")  # Arrow takes no name whose bytes are none in UTF-8
        if self._form is TableFormat.PARQUET:
            writer: _Writer = pyarrow.parquet.ParquetWriter(self._file, self._schema, compression="zstd")
            return writer
        written: _Writer = pyarrow.csv.CSVWriter(
            self._file, self._schema, write_options=pyarrow.csv.WriteOptions(quoting_style="needed")
        )
        return written
