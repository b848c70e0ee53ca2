"""HTTP POST requests to a server, for stores and alarms."""

from __future__ import annotations

import http.client
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Mapping

from ohmward.errors import OhmwardError

#: Longest wait for an answer.
TIMEOUT_S = 20.0

#: Number of bytes read from an answer.
_ANSWER_BYTES = 300


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Refusal of redirects: a redirected request loses its rows and carries the token to another place."""

    def redirect_request(self, *_: object) -> None:
        return None


_OPENER = urllib.request.build_opener(_NoRedirect)


def post(url: str, text: str, headers: Mapping[str, str]) -> tuple[int, str]:
    """Post a text to a server; returns the status of its answer and the beginning of its text, or the status's reason.

    Raises:
        OhmwardError: the server cannot be reached.
    """
    request = urllib.request.Request(url, text.encode(), dict(headers), method="POST")
    try:
        with _OPENER.open(request, timeout=TIMEOUT_S) as answer:
            return answer.status, answer.read(_ANSWER_BYTES).decode("utf-8", "replace").strip()
    except urllib.error.HTTPError as error:
        return error.code, error.read(_ANSWER_BYTES).decode("utf-8", "replace").strip() or str(error.reason)
    except (OSError, http.client.HTTPException) as error:
        reason = getattr(error, "reason", error)
        place = urllib.parse.urlsplit(url).netloc
        raise OhmwardError(f"{place} cannot be reached ({reason}); is the server running?") from error
