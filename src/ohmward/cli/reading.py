"""From the options of a command to its logs."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ohmward.logs import Log


def read(path: str, args: argparse.Namespace, extra: Collection[str] | None = None) -> Log:
    """The log in a file, read as the options of `add_log_options` say.

    extra: further columns to keep; None keeps every numeric one.

    Raises:
        InputError: the file cannot be read as a log.
    """
    from ohmward.logs import read_log

    return read_log(
        Path(path),
        current_sign=args.current_sign,
        columns=dict(args.column),
        units=dict(args.unit),
        where=dict(args.where),
        extra=extra,
        sort_time=args.sort_time,
    )
