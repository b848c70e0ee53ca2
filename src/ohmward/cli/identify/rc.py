"""The RC model of `ohmward identify`: the 75 % rule of [P] beside least squares, for programs and for people."""

from __future__ import annotations

from typing import Any

from ohmward.battery.identification.rc_identification import RcIdentification
from ohmward.battery.models import rc
from ohmward.cli import wording

HEADER = ["RC model", "75 % rule", "least squares"]

#: Rows of the table: name, key of `rc_summary`, unit and its scale.
_ROWS = (
    ("C_b", "c_bulk_F", "F", 1.0),
    ("C_s", "c_surface_F", "F", 1.0),
    ("R_b", "r_bulk_ohm", "mohm", 1e3),
    ("R_s", "r_surface_ohm", "mohm", 1e3),
    ("R_t", "r_terminal_ohm", "mohm", 1e3),
    ("R_0, at once", "r0_ohm", "mohm", 1e3),
    ("R_0 + R_1, steady", "dc_ohm", "mohm", 1e3),
    ("time constant", "tau_s", "s", 1.0),
    ("voltage error, RMS", "residual_rms_V", "mV", 1e3),
)


def rc_summary(found: RcIdentification) -> dict[str, Any]:
    """Object of --json: elements, resistances, time constant and error of the voltage by the rule and by the fit.

    used: the one that the battery file holds.  fit: null where least squares were not possible.
    """
    response, fit = found.response, found.fit
    rule = _circuit(found.rule, found.tau.found, found.rule_rms_V)
    return {
        "used": "rule" if fit is None else "fit",
        "rule": rule | {"edges": response.edges, "delay_s": response.delay_s, "window_s": response.window_s},
        "fit": None if fit is None else _circuit(found.model, fit.r1_ohm > 0, fit.rms_V),
    }


def rc_rows(summary: dict[str, Any]) -> list[list[str]]:
    """Rows of a table under `HEADER`; "-" for what the log does not show."""
    sides = summary["rule"], summary["fit"] or {}
    return [
        [name, *(wording.quantity(side.get(key), unit, scale) for side in sides)] for name, key, unit, scale in _ROWS
    ]


def _circuit(model: rc.RcModel, relaxes: bool, rms_V: float) -> dict[str, Any]:
    """Elements of a circuit and what the voltage shows of them; relaxes: True where the log shows a time constant."""
    _, r0, r1, tau_s = rc.four_numbers(model)
    rest = {"r0_ohm": r0, "dc_ohm": r0 + r1, "tau_s": tau_s if relaxes else None, "residual_rms_V": rms_V}
    return model.circuit._asdict() | rest
