"""The results as Parquet, for who reads them with pandas, Polars, DuckDB or R."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from air_router.files import write_whole
from mocha_link.errors import needs_extra


def write_parquet(path: Path, rows: Sequence[Sequence[Any]]) -> None:
    """Write a table whose first row has the names of its columns.

    A column keeps its numbers as numbers, with nulls where a run has none; one with values of
    several kinds (`battery`: minutes or `none`) is text.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """
    with needs_extra("a Parquet file", "parquet", "air-router"):
        import pyarrow as pa  # noqa: PLC0415 - an extra
        from pyarrow import parquet  # noqa: PLC0415
    heads, *lines = rows
    columns = {
        head: _of_one_kind(values)
        for head, values in zip(heads, zip(*lines, strict=True), strict=True)
    }
    content = io.BytesIO()
    parquet.write_table(pa.table(columns), content, compression="zstd")
    write_whole(path, content.getvalue(), replace=True)


def _of_one_kind(values: Sequence[Any]) -> list[Any]:
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {bool} or kinds <= {str}:
        return list(values)
    if kinds <= {int, float}:
        floats = float in kinds
        return [float(v) if floats and v is not None else v for v in values]
    return [None if value is None else str(value) for value in values]
