"""Line protocol of InfluxDB over HTTP: InfluxDB 1, 2 and 3, VictoriaMetrics, QuestDB and Telegraf take it."""

from __future__ import annotations

import http.client
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Sequence

from ohmward.errors import OhmwardError
from ohmward.onboard.part import LOG
from ohmward.onboard.store.rows import Row

#: An answer that takes longer never comes.
TIMEOUT_S = 20.0

#: Answer of a server that has stored the rows: 204. A page with 200 is that of a proxy or of another server.
_STORED = 204

#: Words of InfluxDB for: stored but for those rows that it will never take, as they are older than it keeps any.
_STORED_IN_PART = "partial write"


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Redirects are refused: what follows one loses its rows and takes the token to whatever it is sent to."""

    def redirect_request(self, *_: object) -> None:
        return None


_OPENER = urllib.request.build_opener(_NoRedirect)

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
        with _OPENER.open(request, timeout=TIMEOUT_S) as answer:
            if answer.status != _STORED:
                raise OhmwardError(f"{place} does not say that it stored the rows ({answer.status}); check url")
    except urllib.error.HTTPError as error:
        answer = error.read(300).decode("utf-8", "replace").strip()
        if _STORED_IN_PART in answer:
            LOG.warning("%s: %s", place, answer)
            return
        raise OhmwardError(
            f"{place} refuses the rows ({error.code} {answer or error.reason}); check url and token"
        ) from error
    except (OSError, http.client.HTTPException) as error:
        reason = getattr(error, "reason", error)
        raise OhmwardError(f"{place} cannot be reached ({reason}); is the server running?") from error
