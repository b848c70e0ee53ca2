"""Figures and findings of `ohmward doctor`, for programs and for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from ohmward.cli import wording
from ohmward.logs import Log
from ohmward.logs.doctor import Finding, Findings
from ohmward.logs.survey import Signal


def summary(paths: Sequence[str], found: Sequence[Findings]) -> dict[str, Any]:
    """The object of --json."""
    logs = [{"path": path} | asdict(one) | {"worst": one.worst} for path, one in zip(paths, found, strict=True)]
    return {"command": "doctor", "logs": logs}


def describe(log: Log, found: Findings) -> str:
    """Figures and findings of a log, for people."""
    return wording.paragraphs(
        f"{log.name}: {wording.grouped(len(log))} samples in {wording.duration(log.duration_s)}",
        wording.fields(contents(log, found)),
        wording.assumptions(found.notes),
        wording.bullets("Found", [f"{finding.severity}: {advised(finding)}" for finding in found.findings])
        or "Found: nothing suspicious.",
    )


def contents(log: Log, found: Findings) -> dict[str, str]:
    """The figures of a log with their units, by name."""
    s = found.survey
    rows = {
        "sampling": f"every {s.sampling.median_s:.3g} s, {s.sampling.shortest_s:.3g} to {s.sampling.longest_s:.4g} s; "
        f"gaps: {s.sampling.gaps}",
        "current": f"{_range(s.current)} A; > 0 charges",
        "voltage": f"{_range(s.voltage)} V",
        "temperature": f"{_range(s.temperature)} degC" if s.temperature else "not recorded",
        "noise": f"{1e3 * s.current.noise_std:.3g} mA, {1e3 * s.voltage.noise_std:.3g} mV",
        "resolution": f"{1e3 * s.current.resolution:.3g} mA, {1e3 * s.voltage.resolution:.3g} mV",
        "charge": f"{s.activity.charge_in_Ah:.4g} Ah in, {s.activity.charge_out_Ah:.4g} Ah out",
        "activity": f"{s.activity.rests} rests, {s.activity.pulses} pulses between rests",
        "at rest": wording.quantity(s.activity.rest_current_A, "mA", 1e3),
        "edges": f"{s.sign.edges} of the current; dV/dI = {wording.quantity(s.sign.resistance_ohm, 'mohm', 1e3)}",
    }
    return rows | ({"also": ", ".join(log.extra)} if log.extra else {})


def advised(finding: Finding) -> str:
    """A finding with its advice, in one line."""
    return f"{finding.text} -> {finding.advice}"


def _range(signal: Signal) -> str:
    return f"{signal.minimum:.5g} to {signal.maximum:.5g}"
