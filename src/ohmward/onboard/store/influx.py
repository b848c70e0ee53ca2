"""Line protocol of InfluxDB over HTTP: InfluxDB 1, 2 and 3, VictoriaMetrics, QuestDB and Telegraf take it."""

from __future__ import annotations

import urllib.parse
from collections.abc import Sequence

from ohmward.errors import OhmwardError
from ohmward.onboard.http_post import post
from ohmward.onboard.part import LOG
from ohmward.onboard.store.rows import Row

#: Answer of a server that has stored the rows: 204. A page with 200 is that of a proxy or of another server.
_STORED = 204

#: Words of InfluxDB for: stored but for those rows that it will never take, as they are older than it keeps any.
_STORED_IN_PART = "partial write"


_TAG = str.maketrans({",": r"\,", "=": r"\=", " ": r"\ ", "\\": r"\\", "\n": r"\ "})


def lines(rows: Sequence[Row], robot: str) -> str:
    """Rows as lines: `drive,robot=rover estimated_speed_m_s=0.8 1700000000000000000`; rows without a value are none."""
    tag = robot.translate(_TAG)
    return "".join(f"{row.kind},robot={tag} {_fields(row)} {row.unix_ns}\n" for row in rows if row.values)


def _fields(row: Row) -> str:
    return ",".join(f"{name.translate(_TAG)}={value!r}" for name, value in row.values.items())


def write_lines(url: str, text: str, token: str = "") -> None:
    """Write lines to a server; a line that is written again replaces itself.

    url: of its write API, `http://HOST:8086/write?db=NAME` (InfluxDB 1, VictoriaMetrics) or
        `http://HOST:8086/api/v2/write?org=ORG&bucket=NAME`.

    Raises:
        OhmwardError: it cannot be reached or refuses.
    """
    headers = {"Content-Type": "text/plain; charset=utf-8"} | ({"Authorization": f"Token {token}"} if token else {})
    status, answer = post(url, text, headers)
    place = urllib.parse.urlsplit(url).netloc
    if _STORED_IN_PART in answer:
        LOG.warning("%s: %s", place, answer)
    elif 200 <= status < 300 and status != _STORED:
        raise OhmwardError(f"{place} does not say that it stored the rows ({status}); check url")
    elif status != _STORED:
        raise OhmwardError(f"{place} refuses the rows ({status} {answer}); check url and token")
