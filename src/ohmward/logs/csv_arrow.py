"""Long text tables of plain numbers by Arrow, where it is installed: the very numbers and text of the standard library.

Whatever is not plain (text, quotes, a line that is cut off) is left to `csv_file` and `write`, which say what is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np

from ohmward.logs.arrays import import_arrow, numbers_of
from ohmward.logs.csv_layout import CsvLayout
from ohmward.logs.table import MISSING, Progress

#: Below this Arrow is not worth its import.
WORTH_BYTES, WORTH_ROWS = 4 << 20, 20_000

#: Bytes that are parsed at a time.
_BLOCK_BYTES = 1 << 23


def read_numbers(
    path: Path, layout: CsvLayout, names: Sequence[str], progress: Progress | None = None
) -> dict[str, np.ndarray] | None:
    """The named columns (T,) of a text table, one row for every line; None where one of its lines is not plain."""
    size = path.stat().st_size
    if size < WORTH_BYTES or not names or (arrow := import_arrow()) is None or not (rows := _plain_rows(path, layout)):
        return None
    from pyarrow import csv

    keys = {name: str(layout.names.index(name)) for name in names}
    columns = {name: np.empty(rows) for name in names}
    first = 0
    try:
        with path.open("rb") as stream:
            for batch in csv.open_csv(stream, *_options(csv, arrow, layout, list(keys.values()))):
                last = first + batch.num_rows
                for name, key in keys.items():
                    columns[name][first:last] = numbers_of(batch[key])
                first = last
                if progress:
                    progress(stream.tell(), size)
    except MemoryError:  # of Arrow, which counts it among its own
        raise
    except (arrow.ArrowException, OSError, ValueError):
        return None
    return columns if first == rows else None


def rows_as_text(columns: Sequence[np.ndarray]) -> str | None:
    """Rows of numbers as lines of a CSV file, NaN an empty cell; None where a column is no number, or rows are few."""
    # a row of one empty cell is quoted by the standard library, lest it be an empty line
    if len(columns) < 2 or len(columns[0]) < WORTH_ROWS or any(c.dtype.kind not in "fiu" for c in columns):
        return None
    if (arrow := import_arrow()) is None:
        return None
    from pyarrow import csv

    cells = [_cells(arrow, values) for values in columns]
    table = arrow.Table.from_arrays(cells, [str(k) for k in range(len(cells))])
    sink = arrow.BufferOutputStream()
    csv.write_csv(table, sink, csv.WriteOptions(include_header=False, quoting_style="none"))
    return sink.getvalue().to_pybytes().decode("ascii")


def _options(csv: ModuleType, arrow: ModuleType, layout: CsvLayout, keys: list[str]) -> tuple:
    """Columns are called by their number, for a file may leave some unnamed."""
    names = [str(k) for k in range(len(layout.names))]
    missing = sorted({"NaN", *(spelling for word in MISSING for spelling in (word, word.upper(), word.title()))})
    return (
        csv.ReadOptions(skip_rows=layout.skip_lines, column_names=names, block_size=_BLOCK_BYTES),
        csv.ParseOptions(delimiter=layout.delimiter, quote_char=False),
        csv.ConvertOptions(
            check_utf8=False,
            column_types=dict.fromkeys(keys, arrow.float64()),
            include_columns=keys,
            null_values=missing,
            decimal_point="," if layout.marks.decimal_comma else ".",
        ),
    )


def _plain_rows(path: Path, layout: CsvLayout) -> int:
    """Lines below the header; 0 where a quote may hide some, or a power failure left zeros."""
    lines = 0
    end = b"\n"
    with path.open("rb") as stream:
        for _ in range(layout.skip_lines):
            stream.readline()
        while block := stream.read(_BLOCK_BYTES):
            if b'"' in block or b"\0" in block:
                return 0
            lines += block.count(b"\n")
            end = block[-1:]
    return lines + (end != b"\n")


def _cells(arrow: ModuleType, values: np.ndarray):
    """The text of every number as Python writes it, null for NaN."""
    from pyarrow import compute

    if values.dtype.kind != "f":
        return compute.cast(arrow.array(values), arrow.string())
    values = values.astype(float, copy=False)
    size = np.abs(values)
    missing = np.isnan(values)
    text = compute.cast(arrow.array(values, mask=missing), arrow.string())
    # the shortest digits are the same; Python writes whole numbers with a point, and takes exponents elsewhere
    whole = (values == np.rint(values)) & (size < 1e10)
    if whole.any():
        pointed = compute.binary_join_element_wise(text, ".0", "")
        text = compute.if_else(arrow.array(whole), pointed, text)
    odd = ~whole & ~missing & ((size < 1e-4) | (size >= 1e10))
    if odd.any():
        spelled = arrow.array([repr(value) for value in values[odd].tolist()], arrow.string())
        text = compute.replace_with_mask(text, arrow.array(odd), spelled)
    return text
