"""A request to a server over HTTP that hands something over, for stores and alarms."""

from __future__ import annotations

import http.client
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Mapping
from typing import NamedTuple

from ohmward.errors import OhmwardError

#: An answer that takes longer never comes.
TIMEOUT_S = 20.0

#: So much of an answer is read.
_ANSWER_BYTES = 300


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Redirects are refused: what follows one loses its rows and takes the token to whatever it is sent to."""

    def redirect_request(self, *_: object) -> None:
        return None


_OPENER = urllib.request.build_opener(_NoRedirect)


class Answer(NamedTuple):
    """Status of an answer, and the beginning of its text or the reason beside its status."""

    status: int
    text: str


def post(url: str, text: str, headers: Mapping[str, str]) -> Answer:
    """Answer of a server to a text.

    Raises:
        OhmwardError: it cannot be reached.
    """
    request = urllib.request.Request(url, text.encode(), dict(headers), method="POST")
    try:
        with _OPENER.open(request, timeout=TIMEOUT_S) as answer:
            return Answer(answer.status, answer.read(_ANSWER_BYTES).decode("utf-8", "replace").strip())
    except urllib.error.HTTPError as error:
        return Answer(error.code, error.read(_ANSWER_BYTES).decode("utf-8", "replace").strip() or str(error.reason))
    except (OSError, http.client.HTTPException) as error:
        reason = getattr(error, "reason", error)
        place = urllib.parse.urlsplit(url).netloc
        raise OhmwardError(f"{place} cannot be reached ({reason}); is the server running?") from error
