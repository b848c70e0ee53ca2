"""Small logs of one simulated battery, exact enough to expect numbers from: a pulse test and a drive of two hours."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import start_model
from ohmward.battery.file import save_battery
from ohmward.battery.models.noise import BatteryNoise
from ohmward.logs import Log, write_log
from ohmward_lab.simulate.voltage import simulate_voltage

CAPACITY_AH = 12.0
MODEL = start_model("nmc", CAPACITY_AH, 3)
NOISE = BatteryNoise(voltage_std_V=0.01)
START_SOC = 0.9


#: A scenario of `ohmward simulate`.
SLIP = """\
format = "ohmward-scenario/1"
duration_s = 0.6
ground = [{ friction = 0.2, rolling = 0.01 }]
observer = { method = "true" }
controller = { mode = "slip" }
commands = [{ slip_ratio = 0.12 }]
"""


def pulse_test() -> Log:
    """From full: a pulse of 30 s, a discharge of 10 %, a rest, nine times over; 10 s apart, noise-free."""
    block = np.concatenate([np.zeros(12), np.full(3, -6.0), np.zeros(12), np.full(36, -12.0), np.zeros(90)])
    current_A = np.concatenate([np.zeros(60), np.tile(block, 9)])
    return _log("test", 10.0 * np.arange(current_A.size), current_A, 1.0)


def drive() -> Log:
    """Two hours at 2 s of changing load from 90 %, with noise of the sensors, and the truth in four forms."""
    rng = np.random.default_rng(3)
    time_s = 2.0 * np.arange(3600)
    current_A = np.where(time_s % 600 < 500, -3.0 + 2.0 * np.sin(time_s / 9.0), 0.0)
    log = _log("day", time_s, current_A, START_SOC)
    soc = log.extra["soc_true"]
    counter_Ah = -log.charge_Ah()
    extra = {
        "soc_true": soc,
        "soc_pct": 100 * soc,
        "discharged_Ah": counter_Ah,
        "charge_mAh": -1000 * counter_Ah,
        "half_true": np.where(time_s < 3600, np.nan, soc),
        "strange": 1e6 * soc,
    }
    current_A = current_A + 0.02 + 0.05 * rng.standard_normal(time_s.size)
    voltage_V = log.voltage_V + 0.005 * rng.standard_normal(time_s.size)
    return Log("day", time_s, current_A, voltage_V, np.full(time_s.size, 25.0), extra)


def battery() -> Battery:
    """The very battery of both logs."""
    return Battery("pack", CAPACITY_AH, "nmc", 3, voltage_min_V=9.0, voltage_max_V=12.6, thevenin=MODEL, noise=NOISE)


def write_files(folder: Path) -> None:
    """test.csv, day.csv, ocv.csv and battery.toml, the names that the help uses."""
    write_log(pulse_test(), folder / "test.csv")
    write_log(drive(), folder / "day.csv")
    save_battery(battery(), folder / "battery.toml")
    soc = np.linspace(0.0, 100.0, 51)
    rows = zip(soc, np.asarray(MODEL.ocv.mean_V(soc / 100, 25.0)) / 3, strict=True)
    (folder / "ocv.csv").write_text("SOC [%],OCV (V)\n" + "".join(f"{s:g},{v:.5f}\n" for s, v in rows))


def _log(name: str, time_s: np.ndarray, current_A: np.ndarray, soc: float) -> Log:
    zeros = np.zeros_like(time_s)
    simulated = simulate_voltage(MODEL, Log(name, time_s, current_A, zeros), soc)
    temperature = np.full(time_s.size, 25.0)
    return Log(name, time_s, current_A, simulated.voltage_V, temperature, {"soc_true": simulated.soc})
