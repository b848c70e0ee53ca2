"""A drive of a robot whose consumption is known by construction, and the files of `ohmward mission`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cli.examples import MODEL
from ohmward.logs import Log, write_table
from ohmward_lab.simulate.voltage import simulate_voltage

IDLE_W, FORCE_N = 12.0, {"grass": 30.0, "gravel": 15.0}
PLAN = """\
format = "ohmward-plan/1"
reserve_soc = 0.1

[[leg]]
distance_m = 1000.0
terrain = "grass"
speed_m_s = 0.5
stop_s = 60.0

[[leg]]
distance_m = 500.0
terrain = "gravel"
speed_m_s = 0.4
grade_rad = 0.01
"""


def drive() -> dict[str, np.ndarray]:
    """Forty minutes over two terrains at several speeds, a stop in each ten minutes."""
    t = np.arange(0.0, 2400.0)
    terrain = np.where(t % 1200 < 600, "grass", "gravel")
    speed = np.where(t % 600 < 540, 0.3 + 0.1 * (t // 300 % 4), 0.0)
    force = np.where(terrain == "grass", FORCE_N["grass"], FORCE_N["gravel"])
    power = (IDLE_W + force * speed) * (1 + 0.05 * np.random.default_rng(1).standard_normal(t.size))
    current = -power / 11.0
    log = simulate_voltage(MODEL, Log("drive", t, current, 0 * t), 0.9)
    return {
        "time_s": t,
        "current_A": current,
        "voltage_V": log.voltage_V,
        "speed_m_s": speed,
        "terrain": terrain,
        "soc_true": log.soc,
    }


def write_mission_files(folder: Path) -> None:
    """drive.csv and plan.toml."""
    columns = drive()
    write_table(columns, folder / "drive.csv")
    write_table({k: v for k, v in columns.items() if k not in ("terrain", "speed_m_s")}, folder / "no_speed.csv")
    (folder / "plan.toml").write_text(PLAN)
