"""Logs of batteries and of drives; readers and writers; units, signs, time."""

from ohmward.logs.doctor import examine
from ohmward.logs.drive_log import DriveLog, read_drive
from ohmward.logs.log import Log, read_log
from ohmward.logs.note import Note
from ohmward.logs.write import write_log, write_table

__all__ = ["DriveLog", "Log", "Note", "examine", "read_drive", "read_log", "write_log", "write_table"]
