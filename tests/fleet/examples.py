"""A small fleet: five logs, the last of them no log; and days of a robot."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import BATTERY_FILE
from ohmward.fleet import Job, ReadOptions
from ohmward.logs import Log, write_log, write_table

SIGNED = ReadOptions(current_sign="charge")


def job() -> Job:
    return Job(BATTERY_FILE.dump(generic_battery("nmc", 2.0)), "coulomb", reading=SIGNED)


def write_fleet(folder: Path) -> list[str]:
    """Paths of the logs."""
    rng = np.random.default_rng(0)
    for k in range(4):
        current = -1.0 + rng.normal(0.0, 0.5, 200 + 50 * k)
        voltage = 3.9 + 0.05 * current - 0.0002 * np.arange(current.size)
        write_log(Log(f"robot{k}", np.arange(current.size) * 1.0, current, voltage), folder / f"robot{k}.csv")
    (folder / "robot4.csv").write_text("this is no log\n")
    return [str(folder / f"robot{k}.csv") for k in range(5)]


BATTERY = generic_battery("nmc", 10.0)
MODEL = BATTERY.thevenin
START_S = datetime(2026, 1, 5, 8, tzinfo=UTC).timestamp()
DAY_S = 86400.0


def day(
    number: int, soc: float, resistance: float = 1.0, hours: float = 2.0, capacity: float = 1.0
) -> dict[str, np.ndarray]:
    """A day of pulses from a charge on, of the battery of the label but for its resistance and capacity."""
    assert MODEL is not None
    time_s = np.arange(0.0, 3600.0 * hours, 10.0)
    current_A = np.where(time_s % 600.0 < 300.0, -4.0, -0.2)
    soc_after = soc + np.cumsum(current_A) * 10.0 / 3600.0 / (10.0 * capacity)
    ocv_V = np.interp(soc_after, np.linspace(0.0, 1.0, len(MODEL.ocv.voltage_V)), MODEL.ocv.voltage_V)
    ohm = resistance * (float(np.median(MODEL.r0_discharge_ohm)) + sum(float(np.median(r)) for r in MODEL.r_ohm))
    unix_s = START_S + DAY_S * number + time_s
    return {"unix_time_s": unix_s, "current_A": current_A, "voltage_V": ocv_V + ohm * current_A}


def write(path: Path, columns: dict[str, np.ndarray], **labels: str) -> str:
    rows = len(columns["current_A"])
    write_table(columns | {name: np.full(rows, value, object) for name, value in labels.items()}, path)
    return str(path)
