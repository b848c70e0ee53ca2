"""Web application of the live page: HTML, server-sent events, a JSON API, its description and metrics; no commands."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import json
import math
import re
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from importlib.resources import files
from typing import Any
from urllib.parse import parse_qs

from ohmward import __version__
from ohmward.energy.leg import Leg
from ohmward.energy.mission import PLAN_FILE
from ohmward.energy.range import summary_of
from ohmward.errors import InputError
from ohmward.json_values import plain
from ohmward.onboard.page.connection import REQUEST_S
from ohmward.onboard.page.dashboard import SPANS, Dashboard, Past, after
from ohmward.onboard.page.metrics import metrics
from ohmward.onboard.robot_state import plain_state
from ohmward.onboard.secrets import is_loopback
from ohmward.optional import require
from ohmward.report.figure import style_sheet

#: Least time between two events, and time between two signs of life if nothing is new.
EVENT_S, ALIVE_S = 0.2, 10.0

#: Most readers of events at once; one more is asked to come back later.
MOST_READERS = 50

#: Delay of the answer to a wrong token, so that guessing takes years.
WRONG_TOKEN_S = 0.5

#: Number of bytes read from the body of a request.
_BODY_BYTES = 4096

_PORT = re.compile(r":\d+$")

_COOKIE = "ohmward_token"
_OPEN = ("/login", "/page.css", "/palette.css")
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_ASSETS = {
    "/": ("onboard.page", "assets/page.html", "text/html"),
    "/page.js": ("onboard.page", "assets/page.js", "text/javascript"),
    "/charts.js": ("onboard.page", "assets/charts.js", "text/javascript"),
    "/page.css": ("onboard.page", "assets/page.css", "text/css"),
    "/uPlot.js": ("report", "vendor/uplot/uPlot.iife.min.js", "text/javascript"),
    "/uPlot.css": ("report", "vendor/uplot/uPlot.min.css", "text/css"),
}

Scope = dict[str, Any]
#: Answers a request of Starlette.
Answer = Callable[[Any], Awaitable[Any]]
Asgi = Callable[[Scope, Callable[..., Awaitable[Any]], Callable[..., Awaitable[Any]]], Awaitable[None]]


def _response(kind: str, *content: Any, **settings: Any) -> Any:
    """Response of Starlette of a kind, "JSONResponse"."""
    return getattr(require("starlette.responses", "the live page"), kind)(*content, **settings)


def make_app(dashboard: Dashboard, token: str = "") -> Asgi:
    """The application.

    token: the one that readers must show; "" admits only readers on this machine, by its own names.
    """
    applications = require("starlette.applications", "the live page")
    routing = require("starlette.routing", "the live page")

    answers = {path: _asset(path) for path in _ASSETS} | _api(dashboard)
    answers["/palette.css"] = _answering(style_sheet, "Response", media_type="text/css")
    routes = [routing.Route(path, answer, methods=["GET"]) for path, answer in answers.items()]
    if token:
        routes.append(routing.Route("/login", _login(token), methods=["GET", "POST"]))
    return guarded(applications.Starlette(routes=routes), token)


def _api(dashboard: Dashboard) -> dict[str, Answer]:
    """Answers with data, by path."""
    return {
        "/api/now": _answering(dashboard.view),
        "/api/state": _answering(lambda: plain_state(dashboard.state) if dashboard.state else {}),
        "/api/history": _history(dashboard),
        "/api/path": _answering(lambda: {"x_m": [x for x, _ in dashboard.path], "y_m": [y for _, y in dashboard.path]}),
        "/api/mission": _mission(dashboard),
        "/metrics": _answering(
            lambda: metrics(dashboard.view()), "PlainTextResponse", media_type="text/plain; version=0.0.4"
        ),
        "/openapi.json": _answering(openapi),
        "/events": _events(dashboard),
    }


def _answering(make: Callable[[], Any], kind: str = "JSONResponse", **settings: Any) -> Answer:
    """Answer with what `make` returns."""

    async def answer(_: Any) -> Any:
        return _response(kind, make(), **settings)

    return answer


def _history(dashboard: Dashboard) -> Answer:
    """Rows in memory, preceded by those of the store."""
    past = Past(dashboard)

    async def history(request: Any) -> Any:
        try:
            since = float(request.query_params.get("since", "-inf"))
        except ValueError:
            since = math.nan
        if math.isnan(since):
            return _response("JSONResponse", {"error": "since must be a number, seconds since 1970"}, status_code=400)
        if (last := request.query_params.get("last")) is None:
            return _response("JSONResponse", dashboard.history(since))
        if last not in SPANS:
            return _response("JSONResponse", {"error": f"last must be one of {', '.join(SPANS)}"}, status_code=400)
        return _response("JSONResponse", after(since, await past.last(last)))

    return history


def _mission(dashboard: Dashboard) -> Answer:
    """Forecast of the mission in the query: one at a time, in a thread."""
    computing = asyncio.Lock()

    async def mission(request: Any) -> Any:
        try:
            asked = mission_of(request.query_params)
            if dashboard.mission is None or (dashboard.state and dashboard.state.is_silent("battery")):
                raise InputError("the charge is not known: the sensors of the battery are silent")
            async with computing:
                forecast = await asyncio.to_thread(dashboard.mission, *asked)
        except InputError as error:
            return _response("JSONResponse", {"error": str(error)}, status_code=409)
        return _response("JSONResponse", plain(summary_of(forecast)))

    return mission


def mission_of(query: Mapping[str, str]) -> tuple[float | Sequence[Leg], float, float | None]:
    """Way, energy of tasks and reserve of a mission from a query: `distance_m` or the text of a `plan`, and `task_J`.

    Raises:
        InputError: neither or both of them, or a value that cannot be.
    """

    def number(name: str, most: float) -> float | None:
        if name not in query:
            return None
        try:
            value = float(query[name])
        except ValueError:
            value = math.nan
        if not 0.0 <= value <= most:
            raise InputError(f"{name} must be a number from 0 to {most:g}, got {query[name]!r:.40}")
        return value

    distance_m, task_J, reserve = number("distance_m", 1e6), number("task_J", 1e9), number("reserve_soc", 0.99)
    if (distance_m is None) == ("plan" not in query):
        raise InputError("give distance_m=METRES, or plan=TEXT of a plan (ohmward mission --plan-example prints one)")
    if distance_m is not None:
        return distance_m, task_J or 0.0, reserve
    try:
        plan = PLAN_FILE.parse(query["plan"])
    except InputError as error:
        raise InputError(f"plan: {error}") from error
    return plan.legs, task_J or 0.0, plan.reserve_soc if reserve is None else reserve


def _events(dashboard: Dashboard) -> Answer:
    """Newest states as they come; a slow reader misses some and holds up nobody."""
    readers = 0

    async def stream() -> AsyncIterator[str]:
        version = 0
        yield "retry: 1000\n\n"
        while not dashboard.ended:
            newest = await dashboard.newer_than(version, ALIVE_S)
            yield f"data: {json.dumps(dashboard.view(), allow_nan=False)}\n\n" if newest > version else ": alive\n\n"
            version = newest
            await asyncio.sleep(EVENT_S)

    async def events(_: Any) -> Any:
        if readers >= MOST_READERS:
            error = {"error": "too many readers; close some"}
            return _response("JSONResponse", error, status_code=503, headers={"Retry-After": "10"})
        response = _response("StreamingResponse", stream(), media_type="text/event-stream")

        async def counted(scope: Scope, receive: Any, send: Any) -> None:
            nonlocal readers
            readers += 1
            try:
                await response(scope, receive, send)
            finally:
                readers -= 1

        return counted

    return events


def _asset(path: str) -> Answer:
    room, name, kind = _ASSETS[path]
    text = files(f"ohmward.{room}").joinpath(*name.split("/")).read_text(encoding="utf-8")
    return _answering(lambda: text, "Response", media_type=kind)


def guarded(app: Asgi, token: str) -> Asgi:
    """The application behind its guard: security headers for browsers, the token, the names of this machine."""

    async def guard(scope: Scope, receive: Any, send: Any) -> None:
        if scope["type"] != "http":
            return
        headers = {key.decode("latin-1").lower(): value.decode("latin-1") for key, value in scope["headers"]}

        async def send_safely(message: dict[str, Any]) -> None:
            if message["type"] == "http.response.start":
                added = [(key.lower().encode(), value.encode()) for key, value in _HEADERS.items()]
                message = {**message, "headers": [*message["headers"], *added]}
            await send(message)

        if not token and not is_loopback(_PORT.sub("", headers.get("host", "localhost")).strip("[]")):
            refusal = _response("JSONResponse", {"error": "open this page as http://127.0.0.1"}, status_code=421)
        elif token and scope["path"] not in _OPEN and not is_known(headers, token):
            refusal = _refusal(scope, headers)
        else:
            await app(scope, receive, send_safely)
            return
        await refusal(scope, receive, send_safely)

    return guard


def is_known(headers: dict[str, str], token: str) -> bool:
    """True if a request shows the token, as `Authorization: Bearer TOKEN` or by the cookie of the login."""
    given = headers.get("authorization", "").encode("latin-1")  # its bytes as they came
    if hmac.compare_digest(given, f"Bearer {token}".encode()):
        return True
    cookies = [part.strip().partition("=") for part in headers.get("cookie", "").split(";")]
    return any(name == _COOKIE and hmac.compare_digest(value.encode(), _ticket(token)) for name, _, value in cookies)


def _ticket(token: str) -> bytes:
    """Content of the cookie: it grants access without revealing the token."""
    return hmac.new(token.encode(), b"ohmward live page", hashlib.sha256).hexdigest().encode()


def _refusal(scope: Scope, headers: dict[str, str]) -> Any:
    if scope["path"] == "/" and "text/html" in headers.get("accept", ""):
        return _response("RedirectResponse", "/login", status_code=303)
    advice = {"error": "give the token: Authorization: Bearer TOKEN"}
    return _response("JSONResponse", advice, status_code=401, headers={"WWW-Authenticate": "Bearer"})


def _login(token: str) -> Answer:
    """Form that takes the token and gives the browser a cookie."""
    form = files("ohmward.onboard.page").joinpath("assets", "login.html").read_text(encoding="utf-8")

    async def login(request: Any) -> Any:
        if request.method == "GET":
            return _response("HTMLResponse", form.replace("$reason", ""))
        try:
            body = await asyncio.wait_for(_first_bytes(request), REQUEST_S)
        except TimeoutError:
            return _response("HTMLResponse", form.replace("$reason", "The token did not come."), status_code=408)
        (given,) = parse_qs(body.decode("latin-1")).get("token", [""])[:1]
        if not hmac.compare_digest(given.encode(), token.encode()):
            await asyncio.sleep(WRONG_TOKEN_S)
            return _response("HTMLResponse", form.replace("$reason", "That is not the token."), status_code=401)
        answer = _response("RedirectResponse", "/", status_code=303)
        secure = request.url.scheme == "https"
        answer.set_cookie(_COOKIE, _ticket(token).decode(), httponly=True, samesite="strict", secure=secure)
        return answer

    return login


async def _first_bytes(request: Any) -> bytes:
    """Beginning of a body; a longer one is cut, and if the sender hangs up it is what has come so far."""
    requests = require("starlette.requests", "the live page")
    body = b""
    with suppress(requests.ClientDisconnect):
        async for chunk in request.stream():
            body += chunk
            if len(body) >= _BODY_BYTES:
                break
    return body[:_BODY_BYTES]


def openapi() -> Any:
    """Description of the API, OpenAPI 3.1."""
    text = files("ohmward.onboard.page").joinpath("assets", "openapi.json").read_text(encoding="utf-8")
    return json.loads(text.replace("$version", __version__))
