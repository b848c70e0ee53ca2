"""From the options of a command to its logs."""

from __future__ import annotations

import argparse
import re
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ohmward.cli.progress import Report, counting

if TYPE_CHECKING:
    from ohmward.logs import Log


_SELECTION = re.compile(r"(?P<path>.+):(?P<where>[^:=,]+=[^:=,]+(,[^:=,]+=[^:=,]+)*)")


def read(
    text: str, args: argparse.Namespace, extra: Collection[str] | None = None, report: Report | None = None
) -> Log:
    """The log that an argument names, read as the options of `add_log_options` say.

    text: a file, or a file and the rows wanted from it, `ocv.parquet:script=1,temp_C=25`, then part of the log's name.
    extra: further columns to keep; None keeps every numeric one.

    Raises:
        InputError: the file cannot be read as a log.
    """
    from ohmward.logs import read_log

    path, where = split_selection(text)
    log = read_log(
        path,
        current_sign=args.current_sign,
        columns=dict(args.column),
        units=dict(args.unit),
        where=dict(args.where) | where,
        extra=extra,
        sort_time=args.sort_time,
        progress=counting(report, f"reading {path.name}"),
    )
    chosen = ",".join(f"{name}={value}" for name, value in where.items())
    return replace(log, name=f"{log.name}:{chosen}") if chosen else log


def split_selection(text: str) -> tuple[Path, dict[str, str]]:
    """The file and the rows wanted from it; a file whose own name looks like that is a file."""
    found = None if Path(text).exists() else _SELECTION.fullmatch(text)
    if found is None:
        return Path(text), {}
    return Path(found["path"]), dict(part.split("=", 1) for part in found["where"].split(","))
