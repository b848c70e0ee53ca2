"""Result of `ohmward run --check`, as text and as the object of --json."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ohmward.cli import wording
from ohmward.onboard.robot_state import Level
from ohmward.onboard.trial import Trial

_TITLES = {
    Level.ERROR: "Wrong, with the fix",
    Level.WARN: "Not told yet",
    Level.OK: "In order",
}


def summary(trial: Trial) -> dict[str, Any]:
    """The object of --json."""
    return {"command": "run --check", "passed": trial.passed, "findings": _findings(trial), "signals": _signals(trial)}


def describe(trial: Trial, setup: str) -> str:
    """The findings by severity, and the verdict."""
    parts = [
        wording.bullets(title, [f"{f.subject}: {f.text}" for f in trial.findings if f.level == level])
        for level, title in _TITLES.items()
        if any(f.level == level for f in trial.findings)
    ]
    wrong = sum(f.level == Level.ERROR for f in trial.findings)
    things = "thing is" if wrong == 1 else "things are"
    verdict = f"{setup}: {wrong} {things} wrong" if wrong else f"{setup}: nothing is wrong; ohmward run {setup}"
    return wording.paragraphs(*parts, verdict)


def _findings(trial: Trial) -> list[dict[str, str]]:
    return [{"subject": f.subject, "level": f.level.name, "text": f.text} for f in trial.findings]


def _signals(trial: Trial) -> Mapping[str, Any]:
    return {
        signal: {
            "sources": record.sources,
            "rate_hz": record.rate_hz,
            "median": record.median,
            "largest": record.largest,
        }
        for signal, record in trial.signals.items()
    }
