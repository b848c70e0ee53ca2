"""Requests of any kind for the server of the live page, over raw sockets: malformed, huge, cut off, slow.

Each input goes over a connection of its own to the page with or without a token, in one piece or in two; some clients
then hang up without reading, and some leave their connections open. Another process serves.
"""

from __future__ import annotations

import asyncio
import logging
import os
import random
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field

from ohmward.onboard.page.dashboard import Dashboard
from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.sinks.page import PageSink
from on_board_day import resident_MB
from on_board_fuzz import Fuzzed, damaged

TOKEN = "a token of the robot"

#: Clients at once, and connections that slow ones leave open at most.
CLIENTS, SLOW = 24, 40

#: A client waits so long for the first bytes of an answer; then it goes.
PATIENCE_S = 0.05

#: Inputs before the memory is looked at first; between two looks at whether somebody who asks properly is answered.
_WARM, LOOK = 5_000, 1_000

#: Somebody who asks properly is answered within this.
ANSWER_S = 5.0

_PATHS = ("/", "/api/now", "/api/state", "/api/history?since=0", "/api/path", "/metrics", "/openapi.json", "/events")
_TOKEN = f"Authorization: Bearer {TOKEN}\r\n".encode()
_FORM = b"token=" + TOKEN.replace(" ", "+").encode()

GOOD = [
    *(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n".encode() + _TOKEN + b"\r\n" for path in _PATHS),
    b"GET /api/now HTTP/1.0\r\n\r\n",
    b"GET /api/now HTTP/1.1\r\nHost: localhost:8080\r\nConnection: close\r\nCookie: ohmward_token=x; a=b\r\n\r\n",
    b"GET /metrics HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\nGET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"POST /login HTTP/1.1\r\nHost: a\r\nContent-Length: %d\r\n\r\n" % len(_FORM) + _FORM,
    b"POST /login HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: chunked\r\n\r\n5\r\ntoken\r\n0\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: a\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Key: x\r\n"
    b"Sec-WebSocket-Version: 13\r\n\r\n",
    b"OPTIONS * HTTP/1.1\r\nHost: a\r\nExpect: 100-continue\r\nContent-Length: 10\r\n\r\n",
    b"GET /" + b"a/../%2e" * 200 + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
]


def huge(rng: random.Random) -> bytes:
    """A request with a header, or with headers, of up to a megabyte."""
    size = 1 << rng.randrange(10, 21)
    one = b"X: " + b"a" * size + b"\r\n"
    many = b"".join(b"X-%d: 1\r\n" % k for k in range(size // 10))
    return b"GET /api/now HTTP/1.1\r\nHost: 127.0.0.1\r\n" + rng.choice((one, many)) + b"\r\n" * rng.randrange(2)


@dataclass
class Clients:
    """Clients of the servers at these ports.

    Attributes:
        sent: number of inputs.  statuses: of the answers.  answers_s: times of proper requests.
    """

    ports: list[int]
    process: int
    rng: random.Random
    sent: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    answers_s: list[float] = field(default_factory=list)
    memory_MB: list[float] = field(default_factory=list)

    async def send(self, inputs: int) -> None:
        """Send so many inputs, and look now and then whether the servers answer."""
        self._slow: list[asyncio.StreamWriter] = []
        while self.sent < inputs:
            until = min(self.sent + LOOK, inputs)
            await asyncio.gather(*(self._client(until) for _ in range(CLIENTS)))
            await self._look()
        for writer in self._slow:
            writer.transport.abort()

    async def _client(self, until: int) -> None:
        while self.sent < until:
            self.sent += 1
            with suppress(OSError):
                await self._one(huge(self.rng) if self.rng.random() < 0.01 else damaged(GOOD, self.rng))

    async def _one(self, data: bytes) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", self.rng.choice(self.ports))
        cut = self.rng.randrange(len(data) + 1) if self.rng.random() < 0.1 else len(data)
        try:
            writer.write(data[:cut])
            if cut < len(data):
                await asyncio.sleep(0.001)
                writer.write(data[cut:])
            chance = self.rng.random()
            if chance < 0.01:
                self._slow.append(writer)
            elif chance < 0.9:
                first = await asyncio.wait_for(reader.read(1 << 16), PATIENCE_S)
                self.statuses[first[9:12].decode("latin-1")] += 1
        except TimeoutError:
            self.statuses["none"] += 1
        finally:
            if writer not in self._slow:
                writer.transport.abort()
        while len(self._slow) > SLOW:
            self._slow.pop(0).transport.abort()

    async def _look(self) -> None:
        """Ask properly; an answer that does not come counts as endless."""
        for port in self.ports:
            from_s = time.monotonic()
            try:
                status = await asyncio.wait_for(asked(port), ANSWER_S)
            except (OSError, TimeoutError):
                status = b""
            self.answers_s.append(time.monotonic() - from_s if status == b"200" else float("inf"))
        if self.sent >= _WARM or not self.memory_MB:
            self.memory_MB.append(resident_MB(self.process))


async def asked(port: int) -> bytes:
    """Status of the answer to a proper request."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(b"GET /api/now HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n" + _TOKEN + b"\r\n")
    answer = await reader.read()
    writer.close()
    return answer[9:12]


def fuzz_http(inputs: int, seed: int = 1) -> Fuzzed:
    """Feed the server; `slowest_s` is the longest time of an answer to somebody who asks properly in between."""
    environment = {**os.environ, "OHMWARD_TEST_TOKEN": TOKEN}
    server = subprocess.Popen(
        [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    )
    assert server.stdin and server.stdout
    began_s = time.perf_counter()
    clients = Clients([int(word) for word in server.stdout.readline().split()], server.pid, random.Random(seed))
    asyncio.run(clients.send(inputs))
    grown_MB = clients.memory_MB[-1] - clients.memory_MB[min(1, len(clients.memory_MB) - 1)]
    out, _ = server.communicate("end\n", timeout=60.0)
    faults = int(out or 0) + (server.returncode != 0) + sum(n for s, n in clients.statuses.items() if s == "500")
    return Fuzzed(clients.sent, max(clients.answers_s), grown_MB, time.perf_counter() - began_s, faults)


class Faults(logging.Handler):
    """Counts errors in the log, which stand on standard error."""

    def __init__(self):
        super().__init__(logging.ERROR)
        self.number = 0

    def emit(self, record: logging.LogRecord) -> None:
        """One more."""
        self.number += 1
        print(record.getMessage(), repr(record.exc_info and record.exc_info[1]), file=sys.stderr)


async def serve() -> None:
    """Serve the page with a token and without, print the ports, and after a line on standard input the errors."""
    faults = Faults()
    logging.getLogger().addHandler(faults)
    sinks = [PageSink(port=0), PageSink(port=0, token="OHMWARD_TEST_TOKEN")]
    dashboards = [Dashboard("robot"), Dashboard("robot")]
    listeners = [sink._listening() for sink in sinks]
    sockets = [listener.__enter__() for listener in listeners]
    servers = [sink._server(dashboard) for sink, dashboard in zip(sinks, dashboards, strict=True)]
    running = [asyncio.create_task(server.serve(sockets=[s])) for server, s in zip(servers, sockets, strict=True)]
    for dashboard in dashboards:
        dashboard.take([RobotState(float(k), 1.7e9 + k) for k in range(100)])
    print(*(s.getsockname()[1] for s in sockets), flush=True)
    await asyncio.to_thread(sys.stdin.readline)
    for dashboard, server in zip(dashboards, servers, strict=True):
        dashboard.end()
        server.should_exit = True
    await asyncio.wait(running, timeout=10.0)
    print(faults.number)


if __name__ == "__main__":
    asyncio.run(serve())
