"""Alarms to a web hook: a message when one is raised, and one when it has ended."""

from __future__ import annotations

import asyncio
import json
import urllib.parse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, ClassVar

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.http_post import post
from ohmward.onboard.part import LOG
from ohmward.onboard.robot_state import Alarm, RobotState
from ohmward.onboard.secrets import check_secret_name, secret

#: Time before a server that is away is tried again [s].
AGAIN_S = 5.0

#: Status of a server that will never take this message, but may take others: bad request, too large, no such media
#: type, unprocessable.
_FOR_GOOD = (400, 413, 415, 422)


@dataclass(frozen=True)
class WebhookSink:
    """Alarms as JSON objects over HTTP; `text` is what chats show, Slack, Mattermost, Home Assistant and others."""

    identity: ClassVar[str] = "robot"  #: setting by which receivers tell robots apart
    url: str  #: address to call, often itself a secret: `env:NAME` takes it from an environment variable
    token: str | None = None  #: secret sent as `Authorization: Bearer`
    robot: str = "robot"  #: name of the robot in the message
    interval_s: float = 1.0  #: least time between two states checked, >= 0
    name: str = "webhook"  #: in diagnostics

    def __post_init__(self) -> None:
        check_secret_name("token", self.token)
        parts = urllib.parse.urlsplit(self.url)
        if not self.url.startswith("env:") and (parts.scheme not in ("http", "https") or not parts.netloc):
            raise InputError(f"url must be http://HOST/PATH, https://HOST/PATH or env:NAME, got {self.url!r}")

    async def run(self, feed: Feed) -> None:
        """Send changes of the alarms until the feed ends; a server that is away is retried, and nothing is lost."""
        url, headers = self._address()
        known: dict[str, Alarm] = {}
        while states := await feed.batch():
            for state in states:
                for message in self.messages(state, known):
                    await self._send(url, headers, message, feed)
                known = {alarm.name: alarm for alarm in state.alarms}

    async def try_out(self) -> None:
        """Look for the secrets without sending anything."""
        self._address()

    def messages(self, state: RobotState, known: Mapping[str, Alarm]) -> Iterator[dict[str, Any]]:
        """Messages about the alarms raised or ended since the previous state; known: alarms of that state."""
        raised = {alarm.name: alarm for alarm in state.alarms}
        changed = [(alarm, True) for name, alarm in raised.items() if name not in known]
        changed += [(alarm, False) for name, alarm in known.items() if name not in raised]
        for alarm, active in changed:
            yield {
                "text": f"{self.robot}: {alarm.text}" if active else f"{self.robot}: over now: {alarm.text}",
                "robot": self.robot,
                "alarm": alarm.name,
                "active": active,
                "at": datetime.fromtimestamp(state.unix_s, UTC).isoformat(timespec="seconds"),
            }

    def _address(self) -> tuple[str, dict[str, str]]:
        url = secret("url", self.url.removeprefix("env:")) if self.url.startswith("env:") else self.url
        token = {"Authorization": f"Bearer {secret('token', self.token)}"} if self.token else {}
        return url, {"Content-Type": "application/json"} | token

    async def _send(self, url: str, headers: Mapping[str, str], message: Mapping[str, Any], feed: Feed) -> None:
        """Send a message until the server takes it or refuses it for good; only once after the feed has ended."""
        text = json.dumps(message, ensure_ascii=False)
        while True:
            try:
                status, answer = await asyncio.to_thread(post, url, text, headers)
                place = urllib.parse.urlsplit(url).netloc
                refusal = f"{place} refuses ({status} {answer}); check url and token"
                feed.trouble = ""
                if status in _FOR_GOOD:
                    LOG.error("alarm %s is not sent: %s", message["alarm"], refusal)
                    feed.trouble = f"alarm {message['alarm']} was not sent: {refusal}"
                elif not 200 <= status < 300:
                    raise OhmwardError(refusal)
                return
            except OhmwardError as error:
                feed.trouble = f"alarm {message['alarm']} waits: {error}"
                if feed.ended:
                    return
                await asyncio.sleep(AGAIN_S)
