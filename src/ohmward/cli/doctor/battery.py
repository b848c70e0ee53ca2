"""Battery files in `ohmward doctor`: what a file does not know, the band that follows, and the test that helps most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

from ohmward.battery.battery import Battery, LogFit
from ohmward.battery.soc.band_forecast import (
    TEMPERATURES_DEGC,
    BandForecast,
    BandsAfterTest,
    forecast,
    forecasts_after_tests,
)
from ohmward.cli import wording
from ohmward.filters.consistency import BAND_95
from ohmward.logs.note import counted
from ohmward.report import Page

#: A test that narrows the bands by less than this share is not listed.
WORTH_A_TEST = 0.05
#: How to read the bands.
READING = "half width of the 95 % band in points, start known / start unknown"


class BatteryFindings(NamedTuple):
    """Findings on a battery file."""

    path: str  #: of the file; bands: of the file; tests: those worth their time, the best first
    battery: Battery
    bands: tuple[BandForecast, ...]
    tests: tuple[BandsAfterTest, ...]


def examine_battery(path: str, battery: Battery) -> BatteryFindings:
    """Forecast the bands of a battery file as it is, and after each test."""
    bands = forecast(battery)
    if not bands:
        return BatteryFindings(path, battery, (), ())
    tests = forecasts_after_tests(battery)
    return BatteryFindings(path, battery, bands, tuple(t for t in tests if _gain(bands, t.bands) >= WORTH_A_TEST))


def battery_summary(found: BatteryFindings) -> dict[str, Any]:
    """The entry of --json."""
    battery = found.battery
    return {
        "path": found.path,
        "name": battery.name,
        "chemistry": battery.chemistry,
        "capacity_Ah": battery.capacity_Ah,
        "not_identified": list(battery.not_identified),
        "bands": [asdict(band) for band in found.bands],
        "tests": [asdict(test) for test in found.tests],
    }


def describe_battery(found: BatteryFindings) -> str:
    """Findings on a battery file, for people."""
    battery = found.battery
    return wording.paragraphs(
        f"{found.path}: battery {battery.name!r}, {wording.quantity(battery.capacity_Ah, 'Ah')}, "
        f"{battery.chemistry or 'chemistry not said'}, {battery.n_series} in series",
        wording.fields(sources(battery)),
        wording.bullets("Not known", battery.not_identified),
        f"{wording.table(band_header(), band_rows(found))}\n({READING})" if found.bands else "",
        "" if found.bands else "No band: this file has no Thevenin model.",
    )


def add_battery(page: Page, found: BatteryFindings) -> Page:
    """The page with the findings on a battery file."""
    page = page.table(["Quantity", "Found"], list(sources(found.battery).items()))
    page = page.table(["Not known"], [[text] for text in found.battery.not_identified])
    if not found.bands:
        return page.text("No band: this file has no Thevenin model.")
    return page.table(band_header(), band_rows(found), wording.sentence(READING))


def sources(battery: Battery) -> dict[str, str]:
    """Provenance of the numbers of a battery."""
    known = battery.identification
    logs = [f"{fit.log} ({fit.test}, SoC {_soc_range(fit)})" for fit in known.logs] if known else []
    models = [name for name in ("thevenin", "rc") if getattr(battery, name) is not None]
    idle = battery.idle_current_A
    exact = taken_as_exact(battery)
    learnt = battery.knowledge.logs if battery.knowledge else ()
    rows = {
        "tests": "; ".join(logs) or "none",
        "learnt from": f"{counted(len(learnt), 'log')}, {sum(log.hours for log in learnt):.1f} h" if learnt else "none",
        "models": ", ".join(models),
        "rest current": "not declared" if idle is None else f"{idle:g} A",
        "current sensor": f"offset ± {BAND_95 * battery.sensor.offset_std_A:.2g} A, "
        f"gain ± {100 * BAND_95 * battery.sensor.gain_std:.2g} % (95 %)",
    }
    return rows | ({"taken as exact": f"{', '.join(exact)}: 0 in [noise]"} if exact else {})


def taken_as_exact(battery: Battery) -> list[str]:
    """Keys of [noise] by which the file takes as exact what no test knows exactly."""
    keys = ["capacity_std", "resistance_std"]
    if battery.thevenin is not None:
        keys += ["activation_std_K", "ocv_std_V_per_K"]
        keys += ["hysteresis_std"] if any(battery.thevenin.ocv.hysteresis_V) else []
    return [key for key in keys if getattr(battery.noise, key) == 0.0]


def _soc_range(fit: LogFit) -> str:
    low, high = (round(100 * min(max(soc, 0.0), 1.0)) for soc in (fit.soc_min, fit.soc_max))
    return f"{low} to {high} %"


def band_header() -> list[str]:
    """Columns of the bands."""
    return ["95 % band on a working day", *(f"{T:g} degC" for T in TEMPERATURES_DEGC)]


def band_rows(found: BatteryFindings) -> list[list[str]]:
    """The bands as the file is, then after each test that is worth its time."""
    rows = [["as the file is", *map(_cell, found.bands)]]
    return rows + [[f"at best, {test.test}", *map(_cell, test.bands)] for test in found.tests]


def _cell(band: BandForecast) -> str:
    return f"± {band.known_start:.1f} / {band.unknown_start:.1f}"


def _gain(before: Sequence[BandForecast], after: Sequence[BandForecast]) -> float:
    """Share by which the bands are narrower."""
    return 1.0 - sum(map(_both, after)) / sum(map(_both, before))


def _both(band: BandForecast) -> float:
    return band.known_start + band.unknown_start
