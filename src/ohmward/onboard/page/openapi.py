"""Description of the API of the live page, OpenAPI 3.1."""

from __future__ import annotations

from typing import Any

from ohmward.onboard.page.dashboard import SPANS
from ohmward.onboard.page.view import HISTORY
from ohmward.onboard.robot_state import RobotState

_NUMBERS = {"type": "array", "items": {"type": ["number", "null"]}}


def openapi(version: str) -> dict[str, Any]:
    """The description; version: that of the package."""
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "ohmward on board",
            "version": version,
            "description": "State of a robot as its estimators have it. SI units, names with their units; null is not "
            "known. It reads only: nothing here commands the robot.",
        },
        "paths": {
            "/api/now": _get("State as the page shows it, with bands of 95 %.", _json(_now())),
            "/api/state": _get(
                "Newest state whole, as the sink `json-lines` writes it.",
                _json({"type": "object", "properties": {name: {} for name in RobotState._fields}}),
            ),
            "/api/history": _history(),
            "/api/path": _get("Path in the frame of the odometry.", _json(_columns("x_m", "y_m"))),
            "/metrics": _get("Metrics for Prometheus.", {"text/plain": {"schema": {"type": "string"}}}),
            "/events": _get("States as server-sent events, like /api/now.", {"text/event-stream": {}}),
        },
        "components": {"securitySchemes": {"token": {"type": "http", "scheme": "bearer"}}},
        "security": [{}, {"token": []}],
    }


def _get(summary: str, content: dict[str, Any], **more: Any) -> dict[str, Any]:
    """One path that is only read."""
    error = _json({"type": "object", "properties": {"error": {"type": "string"}}, "required": ["error"]})
    responses = {
        "200": {"description": "The data.", "content": content},
        "401": {"description": "The token is missing or wrong.", "content": error},
        "421": {"description": "Not by a name of this machine.", "content": error},
    }
    if "parameters" in more:
        responses["400"] = {"description": "A parameter that cannot be.", "content": error}
    if "text/event-stream" in content:
        responses["503"] = {"description": "Too many readers.", "content": error}
    return {"get": {"summary": summary, "responses": responses, **more}}


def _history() -> dict[str, Any]:
    since = {
        "name": "since",
        "in": "query",
        "required": False,
        "description": "Rows after this time, seconds since 1970.",
        "schema": {"type": "number"},
    }
    last = {
        "name": "last",
        "in": "query",
        "required": False,
        "description": "Rows of this time, thinned to some hundred: from memory, and before that from the store.",
        "schema": {"type": "string", "enum": list(SPANS)},
    }
    summary = "Rows in columns; by default those of the last hour and a half, one a second."
    return _get(summary, _json(_columns(*HISTORY)), parameters=[since, last])


def _columns(*names: str) -> dict[str, Any]:
    return {"type": "object", "properties": dict.fromkeys(names, _NUMBERS), "required": list(names)}


def _now() -> dict[str, Any]:
    times = {f"{part}_time_s": {"type": ["number", "null"]} for part in ("battery", "drive")}
    stale = {"type": "string", "description": "Sentence about estimates whose sensors are silent; they are null."}
    advice = {"type": "string", "description": "Sentence on what the operator should do now; empty where nothing is."}
    alarms = {"type": "array", "description": "Alarms that are raised, the most urgent first: name, text, since."}
    totals = {"type": "array", "description": "Sums since ever: name, label, value, unit."}
    known = {"name": {"type": "string"}, "stale": stale, "advice": advice, "alarms": alarms, "totals": totals, **times}
    return {"type": "object", "properties": known, "required": ["name"]}


def _json(schema: dict[str, Any]) -> dict[str, Any]:
    return {"application/json": {"schema": schema}}
