"""One Log type; readers and writers; units, signs, time."""

from ohmward.logs.doctor import examine
from ohmward.logs.log import Log, Note
from ohmward.logs.read import read_log
from ohmward.logs.write import write_log, write_table

__all__ = ["Log", "Note", "examine", "read_log", "write_log", "write_table"]
