"""Line protocol of InfluxDB over HTTP: InfluxDB 1, 2 and 3, VictoriaMetrics, QuestDB and Telegraf take it."""

from __future__ import annotations

import http.client
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Sequence

from ohmward.errors import OhmwardError
from ohmward.onboard.store.rows import Row

#: An answer that takes longer never comes.
TIMEOUT_S = 20.0

_TAG = str.maketrans({",": r"\,", "=": r"\=", " ": r"\ ", "\\": r"\\", "\n": r"\ "})


def lines(rows: Sequence[Row], robot: str) -> str:
    """Rows as lines: `drive,robot=rover estimated_speed_m_s=0.8 1700000000000000000`; rows without a value are none."""
    tag = robot.translate(_TAG)
    return "".join(f"{row.kind},robot={tag} {_fields(row)} {row.unix_ns}\n" for row in rows if row.values)


def _fields(row: Row) -> str:
    return ",".join(f"{name.translate(_TAG)}={value!r}" for name, value in row.values.items())


def post(url: str, text: str, token: str = "") -> None:
    """Write lines to a server; a line that is written again replaces itself.

    url: of its write API, `http://HOST:8086/write?db=NAME` (InfluxDB 1, VictoriaMetrics) or
        `http://HOST:8086/api/v2/write?org=ORG&bucket=NAME`.

    Raises:
        OhmwardError: it cannot be reached or refuses.
    """
    headers = {"Content-Type": "text/plain; charset=utf-8"} | ({"Authorization": f"Token {token}"} if token else {})
    request = urllib.request.Request(url, text.encode(), headers, method="POST")
    place = urllib.parse.urlsplit(url).netloc
    try:
        with urllib.request.urlopen(request, timeout=TIMEOUT_S):
            return
    except urllib.error.HTTPError as error:
        said = error.read(300).decode("utf-8", "replace").strip()
        raise OhmwardError(
            f"{place} refuses the rows ({error.code} {said or error.reason}); check url and token"
        ) from error
    except (OSError, http.client.HTTPException) as error:
        reason = getattr(error, "reason", error)
        raise OhmwardError(f"{place} cannot be reached ({reason}); is the server running?") from error
