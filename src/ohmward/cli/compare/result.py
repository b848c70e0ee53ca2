"""Figures of `ohmward compare`, for programs and for people."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ohmward.battery.soc.estimator import SocRun
from ohmward.battery.soc.score import soc_rms_differences, soc_scores, voltage_score
from ohmward.cli import wording
from ohmward.cli.battery_inputs import SocTask

Column = Callable[[Mapping[str, Any]], str]


def summary(task: SocTask, answers: Mapping[str, SocRun]) -> dict[str, Any]:
    """The object of --json."""
    return {
        "command": "compare",
        "log": task.log.name,
        "battery": task.battery.name,
        "steps": len(task.log),
        "duration_s": task.log.duration_s,
        "estimators": {name: _figures(task, answer) for name, answer in answers.items()},
        "soc_rms_differences": soc_rms_differences({name: answer.estimates for name, answer in answers.items()}),
        "truth": task.truth.note if task.truth else None,
        "notes": task.notes,
    }


def describe(task: SocTask, figures: Mapping[str, Any]) -> str:
    """Text for people."""
    tables = (wording.table(header, rows) for header, rows in tables_of(task, figures))
    title = f"{figures['log']} with battery {figures['battery']!r}: {figures['steps']:,} samples"
    return wording.paragraphs(title, *tables, wording.assumptions(task.notes))


def tables_of(task: SocTask, figures: Mapping[str, Any]) -> list[tuple[list[str], list[list[str]]]]:
    """Header and rows of each table: as [T] tables 3.1-3.3, as [P], and the mutual differences without a truth."""
    estimators = figures["estimators"]
    if task.truth:
        return [_table(estimators, _SIGNED), _table(estimators, _SIZES)]
    return [_table(estimators, _WITHOUT_TRUTH), _difference_table(figures["soc_rms_differences"])]


def _figures(task: SocTask, answer: SocRun) -> dict[str, Any]:
    log, estimates = task.log, answer.estimates
    voltage = voltage_score(log, estimates)
    return {
        "seconds": answer.seconds,
        "us_per_step": 1e6 * answer.seconds / len(log),
        "soc_final": float(estimates.soc[-1]),
        "soc_std_final": float(estimates.soc_std[-1]),
        "voltage_error_mean_V": voltage.mean if voltage else None,
        "voltage_error_std_V": voltage.std if voltage else None,
        "voltage_max_error_V": voltage.max_error if voltage else None,
        "voltage_rmse_V": voltage.rmse if voltage else None,
        "flags": answer.counts(),
        **soc_scores(log, estimates, task.truth.soc if task.truth else None),
    }


def _percent(key: str, digits: int = 2) -> Column:
    return lambda figures: wording.percent(figures[key], digits)


def _millivolts(key: str) -> Column:
    return lambda figures: wording.quantity(figures[key], "mV", 1e3)


_SIGNED: dict[str, Column] = {
    "voltage error: mean": _millivolts("voltage_error_mean_V"),
    "std": _millivolts("voltage_error_std_V"),
    "max": _millivolts("voltage_max_error_V"),
    "SoC error: mean": _percent("soc_error_mean"),
    "std ": _percent("soc_error_std"),
    "max ": _percent("soc_max_error"),
}
_SIZES: dict[str, Column] = {
    "SoC: MAE": _percent("soc_mae"),
    "RMSE": _percent("soc_rmse"),
    "max": _percent("soc_max_error"),
    "RMSE after 1 h": _percent("soc_rmse_after_1h"),
    "in 95 % band": _percent("coverage_95", 1),
    "per step": lambda figures: f"{figures['us_per_step']:.3g} us",
}
_WITHOUT_TRUTH: dict[str, Column] = {
    "SoC at the end": _percent("soc_final", 1),
    "its std": _percent("soc_std_final", 1),
    **dict(list(_SIGNED.items())[:3]),
    "per step": _SIZES["per step"],
}


def _table(estimators: Mapping[str, Any], columns: Mapping[str, Column]) -> tuple[list[str], list[list[str]]]:
    rows = []
    for name, figures in estimators.items():
        rows.append([name, *(cell(figures) for cell in columns.values())])
    return ["estimator", *columns], rows


def _difference_table(differences: Mapping[str, Mapping[str, float]]) -> tuple[list[str], list[list[str]]]:
    rows = []
    for name, row in differences.items():
        rows.append([name, *(wording.percent(row.get(other)) for other in differences)])
    return ["SoC difference, RMS", *differences], rows
