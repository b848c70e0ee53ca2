"""One Log type; readers and writers; units, signs, time."""

from ohmward.logs.log import Log, Note
from ohmward.logs.read import read_log

__all__ = ["Log", "Note", "read_log"]
