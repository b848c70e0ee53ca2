"""Figures of the cells of a pack in `ohmward soc`, for programs, for people and along the log."""

from __future__ import annotations

from typing import Any

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.cells.drift import ranges
from ohmward.battery.cells.pack_estimator import PackRun, estimate_at
from ohmward.battery.cells.unseen import unseen_weakest
from ohmward.battery.soc.sample import SocEstimate
from ohmward.cli import wording
from ohmward.filters.consistency import BAND_95

HEADER = ("Cell", "SoC [%]", "minus typical [points]", "Capacity over typical [%]", "Resistance over typical [%]")


def cells_summary(run: PackRun) -> dict[str, Any]:
    """The object `cells` of --json: at the end of the log."""
    now = estimate_at(run.estimates, -1)
    pack, cells = now.pack, now.cells
    names = run.names
    fields = [name for name in cells._fields if name != "flags"]
    return {
        "weakest": names[int(pack.weakest)],
        **{name: float(value) for name, value in pack._asdict().items() if name != "weakest"},
        "ranges": {name: {"value": value, "std": std} for name, (value, std) in ranges(cells).items()},
        "warnings": [warning._asdict() | {"cell": names[warning.cell]} for warning in run.warnings()],
        "first_warning_s": run.first_warning_s(),
        "cells": [
            {"name": name, **{field: float(getattr(cells, field)[k]) for field in fields}}
            for k, name in enumerate(names)
        ],
    }


def cells_result(figures: dict[str, Any]) -> dict[str, str]:
    """The key figures of the pack with their units, by name."""
    cells = figures["cells"]
    ranges_ = cells["ranges"]
    return {
        "weakest cell": f"{cells['weakest']}, {_band(cells['weakest_soc'], cells['weakest_soc_std'])} % (95 %)",
        "usable charge": f"{cells['usable_Ah']:.3g} ± {BAND_95 * cells['usable_std_Ah']:.2g} Ah, until that cell is "
        "empty",
        "pack": f"{_band(cells['soc'], cells['soc_std'])} % of {cells['capacity_Ah']:.3g} Ah between the ends that its "
        "cells set",
        "cells differ": ", ".join(
            f"{name} by {_band(found['value'], found['std'])} {'points' if name == 'SoC' else '%'}"
            for name, found in ranges_.items()
        ),
    }


def unseen_summary(battery: Battery, estimates: SocEstimate) -> dict[str, float] | None:
    """The object `weakest_unseen` of --json, of a pack whose cells the log does not have: at the end of the log."""
    if battery.n_series < 2:
        return None
    expected = unseen_weakest(float(estimates.soc[-1]), float(estimates.soc_std[-1]), int(battery.n_series))
    return {"soc": float(expected.mean), "soc_std": float(expected.std)}


def unseen_result(figures: dict[str, Any]) -> dict[str, str]:
    """The weakest cell where it was not measured; nothing for a single cell."""
    found = figures["weakest_unseen"]
    return {"weakest cell": f"not measured; probably {_band(found['soc'], found['soc_std'])} %"} if found else {}


def cells_sentence(figures: dict[str, Any]) -> str:
    """SoC of the pack and its weakest cell in one sentence; nothing for a log without cells."""
    if not figures["cells"]:
        return ""
    cells = figures["cells"]
    pack = _band(cells["soc"], cells["soc_std"])
    return f"Pack {pack} %: {cells['weakest']} will be empty first. Typical cell: "


def cells_text(figures: dict[str, Any]) -> str:
    """The cells for people; nothing for a log without them."""
    if not figures["cells"]:
        return ""
    warnings = [warning["text"] for warning in figures["cells"]["warnings"]]
    return wording.paragraphs(
        "Cells\n" + wording.fields(cells_result(figures)),
        wording.table(HEADER, cell_rows(figures)),
        wording.bullets("Cells that drift apart from the others", warnings),
    )


def cell_rows(figures: dict[str, Any]) -> list[list[str]]:
    """One row for each cell, with the half widths of its 95 % bands."""
    return [
        [
            cell["name"],
            _band(cell["soc"], cell["soc_std"]),
            _band(cell["soc_difference"], cell["soc_difference_std"]),
            _band(cell["capacity_ratio"], cell["capacity_ratio_std"]),
            _band(cell["resistance_ratio"], cell["resistance_ratio_std"]),
        ]
        for cell in figures["cells"]["cells"]
    ]


def cell_columns(run: PackRun) -> dict[str, np.ndarray]:
    """Columns (T,) of the estimates file, by name; the number of the weakest cell counts from 1."""
    pack = {f"pack_{name}": values for name, values in run.pack._asdict().items() if not name.startswith("weakest")}
    weakest = {
        "weakest_cell": run.pack.weakest + 1,
        "weakest_soc": run.pack.weakest_soc,
        "weakest_soc_std": run.pack.weakest_soc_std,
    }
    each = {
        f"cell_{k + 1}_{name}": getattr(run.cells, name)[:, k]
        for k in range(len(run.names))
        for name in ("soc", "soc_std", "capacity_ratio", "resistance_ratio")
    }
    return pack | weakest | each


def _band(share: float, std: float) -> str:
    return f"{100 * share:.1f} ± {100 * BAND_95 * std:.1f}"
