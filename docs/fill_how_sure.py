"""Fill the tables of `docs/how-sure.md` from the code: `python docs/fill_how_sure.py`.

The priors and their meaning come from the table that the filter uses; the bands are those of `ohmward doctor` for
batteries of which only chemistry and capacity are known, and for the battery of the demo after its pulse test.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, TypeVar

from marked_block import replaced

import ohmward as ow
from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import (
    CHEMISTRIES,
    ChemistryPrior,
    CurvePrior,
    HysteresisPrior,
    Normal,
    chemistry_prior,
)
from ohmward.battery.soc.band_forecast import TEMPERATURES_DEGC, BandForecast, forecast, forecasts_after_tests
from ohmward.embedded.comments import field_comments

T = TypeVar("T")
PAGE = Path(__file__).parent / "how-sure.md"
CAPACITY_AH, N_SERIES = 12.0, 4


def main() -> None:
    """Rewrite the blocks between the markers."""
    text = described(PAGE.read_text(encoding="utf-8"))
    PAGE.write_text(replaced(text, "bands", band_table()), encoding="utf-8")


def described(text: str) -> str:
    """The text of the page with the table of priors made anew."""
    return replaced(text, "priors", prior_table())


def attributes(cls: type) -> dict[str, str]:
    """Meaning of each field of a record; names that share one stand in one row."""
    by_meaning = groupby(field_comments(cls).items(), key=lambda item: item[1])
    return {"`, `".join(name for name, _ in fields): text for text, fields in by_meaning}


def prior_table() -> list[str]:
    """A row for each prior that differs between chemistries: of NMC, and of those that have another."""
    meaning = attributes(ChemistryPrior)
    rows = []
    for key in ChemistryPrior._fields:
        text = next((text for shown, text in meaning.items() if key in shown.split("`, `")), "")
        usual, others = values_of(key)
        if others:
            rows.append(f"| `{key}` | {text} | {usual} | {others} |")
    return ["| prior | | nmc | others |", "|---|---|---|---|", *rows]


def values_of(key: str) -> tuple[str, str]:
    """A prior of NMC, and each other value with the chemistries that have it."""
    usual = value_of(getattr(chemistry_prior("nmc"), key))
    others: dict[str, list[str]] = {}
    for name in (*CHEMISTRIES, ""):
        others.setdefault(value_of(getattr(chemistry_prior(name), key)), []).append(name or "not named")
    return usual, "; ".join(f"{', '.join(names)} {value}" for value, names in others.items() if value != usual)


def value_of(value: Any) -> str:
    """A prior as mean and standard deviation, as its range between the ends of the curve, or by its numbers."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, HysteresisPrior):
        return f"{value_of(value.share)}, {value.rate:g}"
    if isinstance(value, Normal):
        return f"{value.mean:g} ± {value.std:g}"
    if isinstance(value, CurvePrior):
        inside = value.std_V[1:-1] or value.std_V
        return " to ".join(f"{std_V:g}" for std_V in sorted({min(inside), max(inside)}))
    if isinstance(value, tuple):
        return " or ".join(f"{number:g}" for number in value)
    return f"{value:g}"


def band_table() -> list[str]:
    """Bands of four battery files as they are, and after each test that narrows them, warm and cold."""
    header = " | ".join(f"{degC:g} degC" for degC in ends(TEMPERATURES_DEGC))
    lines = [f"| battery file | {header} |", "|---|---|---|"]
    for title, battery in batteries().items():
        before = forecast(battery)
        lines.append(f"| **{title}** | {cells(ends(before))} |")
        for after in forecasts_after_tests(battery):
            if total(after.bands) < 0.95 * total(before):
                lines.append(f"| {after.test} | {cells(ends(after.bands))} |")
    return lines


def ends(values: Sequence[T]) -> tuple[T, T]:
    """The first and the last."""
    return values[0], values[-1]


def batteries() -> dict[str, Battery]:
    """Battery files by title: label only, and after the pulse test of the demo."""
    label = {
        f"{name}, label only": ow.generic_battery(name, CAPACITY_AH, N_SERIES) for name in ("nmc", "lfp", "lead-acid")
    }
    test = ow.make_robot_day("lfp").pulse_test
    return label | {
        "lfp, pulse test at 20 degC": ow.identify(test, capacity_Ah=CAPACITY_AH, chemistry="lfp", n_series=N_SERIES)
    }


def cells(bands: Iterable[BandForecast]) -> str:
    """Half widths with a known and an unknown start, one cell for each temperature."""
    return " | ".join(f"{band.known_start:.1f}, {band.unknown_start:.1f}" for band in bands)


def total(bands: Iterable[BandForecast]) -> float:
    """Sum of all half widths."""
    return sum(band.known_start + band.unknown_start for band in bands)


if __name__ == "__main__":
    main()
