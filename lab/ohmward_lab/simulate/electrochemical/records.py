"""Logs of a simulated electrochemical cell: bench tests and working days, as the sensors of a robot record them."""

from __future__ import annotations

import numpy as np

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.checks import require_one_of
from ohmward.logs import Log, Note
from ohmward_lab.simulate.electrochemical.cell import ElectrochemicalCell
from ohmward_lab.simulate.electrochemical.days import DayPlan, first_discharged, working_day
from ohmward_lab.simulate.electrochemical.run import CellTruth, capacity_Ah, simulate_cell
from ohmward_lab.simulate.profile import Profile, bench_times, low_rate_profile, pulse_profile
from ohmward_lab.simulate.sensors import BatterySensors, Sensor

#: What `record_cell` knows to record, and what each is.
RECORDS = {
    "pulse-test": "from full to empty in steps of 10 %, with pulses and an hour of rest at each",
    "low-rate-test": "from full to empty and back at C/20",
    "day": "eight hours of drives, pauses and rests from full, two charges in between",
}
#: Interval [s] of a low-rate test's logger and of a robot's.
_SLOW_S, _ROBOT_S = 10.0, 1.0
#: Resolution [V] of a usual converter, for one cell.
FINE_V = 0.001
#: Distance [V] of one cell from its cut-off at which a test has reached it.
_CUT_OFF_V = 0.005


def record_cell(
    cell: ElectrochemicalCell, record: str, ambient_degC: float = ROOM_DEGC, seed: int = 1, new_Ah: float | None = None
) -> Log:
    """Log of a test or a day from full, with the true SoC as the extra column `soc_true`.

    record: of RECORDS.  seed: draws the drives of a day and the noise.  new_Ah: capacity of the new cell [Ah], of which
    currents are multiples; by default the capacity that the cell has.

    Raises:
        InputError: another record.
    """
    require_one_of("record", record, tuple(RECORDS))
    rng = np.random.default_rng(seed)
    rate_Ah = capacity_Ah(cell) if new_Ah is None else new_Ah
    profile, time_s = _load(record, rate_Ah, ambient_degC, rng)
    truth = simulate_cell(cell, profile, time_s)
    truth = truth if record == "day" else until_cut_off(truth, cell)
    name = f"simulated {cell.parameter_set} {record} at {ambient_degC:g} degC"
    log = log_of(truth, usual_sensors(rate_Ah, cell.n_series), rng, name)
    note = Note(f"simulated, not measured: PyBaMM's {cell.parameter_set}, {cell.model}, {capacity_Ah(cell):.4g} Ah")
    return log.with_notes(note)


def _load(record: str, rate_Ah: float, degC: float, rng: np.random.Generator) -> tuple[Profile, np.ndarray]:
    """Load of a record and the times [s] at which its logger samples."""
    if record == "pulse-test":
        profile = pulse_profile(rate_Ah, degC)
        return profile, bench_times(profile)
    if record == "low-rate-test":
        profile = low_rate_profile(rate_Ah, degC)
        return profile, np.arange(0.0, profile.time_s[-1], _SLOW_S)
    profile, _ = first_discharged(working_day(rng, rate_Ah, DayPlan(degC)), rate_Ah, 0.0)
    return profile, np.arange(0.0, profile.time_s[-1], _ROBOT_S)


def until_cut_off(truth: CellTruth, cell: ElectrochemicalCell) -> CellTruth:
    """The truth of a test to its first cut-off where the model of the empty cell is not to be trusted: lead-acid."""
    below = truth.voltage_V <= cell.n_series * (cell.limits.low_V + _CUT_OFF_V)
    if cell.model != "lead-acid" or not below.any():
        return truth
    return CellTruth(*(values[: np.argmax(below) + 1] for values in truth))


def usual_sensors(
    capacity_Ah: float, n_series: int = 1, offset: float = 0.0, gain: float = 0.0, voltage_step_V: float = FINE_V
) -> BatterySensors:
    """Sensors of a robot with this offset of the current, as a share of C, and this error of its gain.

    Current: noise of 0.2 %, resolution of 0.1 % of C. Voltage: noise of 1 mV and the resolution given, of each cell.
    Temperature: 0.1 K.
    """
    C, cells = capacity_Ah, n_series
    return BatterySensors(
        Sensor(-10 * C, 10 * C, 0.001 * C, 0.002 * C, offset=offset * C, gain_error=gain),
        Sensor(0.0, 10.0 * cells, voltage_step_V * cells, 0.001 * cells),
        Sensor(-55.0, 125.0, 0.1, 0.05),
    )


def log_of(truth: CellTruth, sensors: BatterySensors, rng: np.random.Generator, name: str) -> Log:
    """Log of the truth, its time from 0, with the true SoC as the extra column `soc_true`."""
    time_s = truth.time_s - truth.time_s[0]
    return Log(
        name,
        time_s,
        sensors.current.measure(truth.current_A, time_s, rng),
        sensors.voltage.measure(truth.voltage_V, time_s, rng),
        sensors.temperature.measure(truth.temperature_degC, time_s, rng),
        extra={"soc_true": truth.soc},
    )
