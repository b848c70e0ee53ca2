"""Facts about a file that it does not contain, or not clearly: the options of reading, which need no NumPy."""

from __future__ import annotations

import codecs
from collections.abc import Sequence
from typing import NamedTuple
from zoneinfo import ZoneInfo

from ohmward.errors import InputError
from ohmward.quantities import DAY_S

#: Value of `time_format` for days since 1899-12-30.
EXCEL = "excel"
#: First bytes by which a format is recognised: enough for HDF5 after a user block, and the beginning of JSON.
HEAD_BYTES = 4096
#: Key in `where` that names topics: `--topic /a` is `--where topic=/a`.
TOPIC = "topic"


class FileHints(NamedTuple):
    """Facts about a file, each None where it is to be found in the file."""

    names: Sequence[str] | None = None  #: of the columns, for a table without a header
    encoding: str | None = None  #: of a text file, as Python names it: "cp1251"
    time_format: str | None = None  #: of dates as text, in the notation of `strptime`: "%d/%m/%Y %H:%M:%S"; or "excel"
    timezone: str | None = None  #: of dates that name none: "Europe/Berlin"
    #: the part to read, from `start` to just before `stop`: seconds of the log, h:mm:ss, or a date
    start: str | None = None
    stop: str | None = None
    sample_time_s: float | None = None  #: interval [s] between the rows of a table without a time
    temperature_degC: float | None = None  #: of the battery, where the log has none
    dbc: str | None = None  #: path of the CAN database, for a recording of CAN frames

    def checked(self) -> FileHints:
        """The same hints; InputError for an unknown encoding or time zone, or an interval out of its range."""
        if self.encoding is not None:
            try:
                codecs.lookup(self.encoding)
            except LookupError:
                raise InputError(
                    f"--encoding (encoding) must be one that Python knows, like cp1251 or shift_jis; got "
                    f"{self.encoding!r}"
                ) from None
        if self.timezone is not None:
            zone_of(self.timezone)
        if self.sample_time_s is not None and not 0 < self.sample_time_s <= DAY_S:
            rule = f"must be > 0 s and at most a day, {DAY_S:g} s"
            raise InputError(f"--sample-time (sample_time_s) {rule}; got {self.sample_time_s:g}")
        return self


def zone_of(name: str) -> ZoneInfo:
    """The time zone of a name; InputError where there is no such zone."""
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise InputError(
            f"--timezone (timezone) must be a name of the IANA database, like Europe/Berlin or UTC; got {name!r}"
        ) from None
