"""Logs of batteries and of drives; readers and writers; units, signs, time. Each name is loaded when it is used."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ohmward.logs.doctor import examine as examine
    from ohmward.logs.drive_log import DriveLog as DriveLog
    from ohmward.logs.drive_log import read_drive as read_drive
    from ohmward.logs.hints import FileHints as FileHints
    from ohmward.logs.log import Log as Log
    from ohmward.logs.log import read_log as read_log
    from ohmward.logs.table import Note as Note
    from ohmward.logs.write import write_log as write_log
    from ohmward.logs.write import write_table as write_table

_HOMES = {
    "DriveLog": "drive_log",
    "FileHints": "hints",
    "Log": "log",
    "Note": "table",
    "examine": "doctor",
    "read_drive": "drive_log",
    "read_log": "log",
    "write_log": "write",
    "write_table": "write",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    """Load a name from its module on first use: a robot that estimates its charge needs no reader of drives."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
