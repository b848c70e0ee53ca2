"""Live page of the robot in a browser, with its API and metrics."""

from __future__ import annotations

import asyncio
import socket
import ssl
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ohmward.checks import require_between
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.line_reader import cannot_listen
from ohmward.onboard.page.app import make_app
from ohmward.onboard.page.connection import connection_type
from ohmward.onboard.page.dashboard import Dashboard
from ohmward.onboard.part import LOG
from ohmward.onboard.secrets import check_secret_name, is_loopback, secret
from ohmward.optional import require

#: Time given to readers still connected at the end [s].
_READERS_END_S = 1.0


@dataclass(frozen=True)
class PageSink:
    """A page on loopback; on other addresses only for readers with the token."""

    host: str = "127.0.0.1"  #: address to listen on: "127.0.0.1" for this machine alone, "0.0.0.0" for the network
    port: int = 8080  #: TCP port; 0 takes a free one
    token: str | None = None  #: secret that any host but loopback requires
    #: paths of the TLS files; both or none
    certificate: str | None = None
    key: str | None = None
    robot: str = "robot"  #: title of the page
    #: folder of the store whose history is shown; default: that of the sink `store` in this setup
    store: str | None = None
    interval_s: float = 0.1  #: least time between two states shown, >= 0
    name: str = "page"  #: in diagnostics

    def __post_init__(self) -> None:
        require_between("port", self.port, 0, 65535)
        check_secret_name("token", self.token)
        if self.token is None and not is_loopback(self.host):
            raise InputError(
                f"the page on {self.host} could be read by the whole network; give token = "
                '"file:/etc/ohmward/token" (a file of mode 600), or keep host = "127.0.0.1"'
            )
        if (self.certificate is None) != (self.key is None):
            raise InputError("certificate and key go together: give both for TLS, or none")

    async def run(self, feed: Feed) -> None:
        """Serve the page until the feed ends."""
        dashboard = Dashboard(self.robot, Path(self.store) if self.store else None, feed.mission)
        server = self._server(dashboard)
        with self._listening() as listener:
            serving = asyncio.create_task(server.serve(sockets=[listener]))
            LOG.info("the page of %s: %s", self.robot, self._address(listener))
            try:
                while states := await feed.batch():
                    dashboard.take(states)
                    if serving.done():
                        cause = serving.exception()
                        raise OhmwardError(
                            f"the server of the page has ended{f': {cause}' if cause else ''}"
                        ) from cause
            finally:
                dashboard.end()
                server.should_exit = True
                await asyncio.wait([serving], timeout=2.0 * _READERS_END_S)
                serving.cancel()

    def _server(self, dashboard: Dashboard) -> Any:
        uvicorn = require("uvicorn", "the live page")
        app = make_app(dashboard, secret("token", self.token))
        if self.certificate and self.key:
            check_certificate(self.certificate, self.key)
        config = uvicorn.Config(
            app,
            http=connection_type(),
            ws="none",
            log_config=None,
            log_level="error",
            access_log=False,
            lifespan="off",
            server_header=False,
            timeout_graceful_shutdown=_READERS_END_S,
            ssl_certfile=self.certificate,
            ssl_keyfile=self.key,
        )
        server = uvicorn.Server(config)
        server.capture_signals = nullcontext  # they belong to the process
        return server

    def _listening(self) -> socket.socket:
        """The socket that the server listens on."""
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        try:
            return socket.create_server((self.host, self.port), family=family)
        except OSError as error:
            raise cannot_listen(f"port {self.port} of {self.host}", error) from error

    def _address(self, listener: socket.socket) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http{'s' if self.certificate else ''}://{host}:{listener.getsockname()[1]}"


def check_certificate(certificate: str, key: str) -> None:
    """Raise OhmwardError unless TLS can begin with a certificate and its key, both paths of PEM files."""
    for path in (certificate, key):
        if not Path(path).is_file():
            raise OhmwardError(f"{path} is no file; give the paths of certificate and key for TLS")
    try:
        _load_certificate(certificate, key)
    except (ssl.SSLError, OSError, ValueError) as error:
        try:
            _load_certificate(key, certificate)
        except (ssl.SSLError, OSError, ValueError):
            reason = getattr(error, "reason", "") or getattr(error, "strerror", "") or error
            raise OhmwardError(
                f"TLS cannot begin with certificate {certificate} and key {key} ({reason}); give a certificate and the "
                "key that belongs to it, without a passphrase, as PEM files that ohmward may read"
            ) from error
        raise OhmwardError(f'certificate and key are swapped; certificate = "{key}", key = "{certificate}"') from error


def _load_certificate(certificate: str, key: str) -> None:
    # without the empty passphrase OpenSSL would ask for one on the terminal
    ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
