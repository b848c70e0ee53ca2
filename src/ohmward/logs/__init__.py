"""One Log type; readers and writers; units, signs, time."""

from ohmward.logs.log import Log, Note

__all__ = ["Log", "Note"]
