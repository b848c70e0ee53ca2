"""Faults of a log that would corrupt what is learnt: some are repaired, others set the log aside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.charge_count import require_followed
from ohmward.battery.learning.fold import pulse_ohm
from ohmward.battery.log_check import (
    MEDIAN_OF,
    check_log,
    hidden_charges,
    medians,
    moving_rests,
    other_cells,
)
from ohmward.battery.soc.anchor_rule import REST_C
from ohmward.errors import InputError
from ohmward.logs.log import SECONDS_PER_HOUR, Log, Note, without_impossible
from ohmward.quantities import QUANTITIES
from ohmward.runs import runs
from ohmward.signals.current_sign import check_current_sign, sign_evidence
from ohmward.signals.current_size import HIDDEN_CHARGE
from ohmward.signals.survey import resolution

#: Fewest samples with current and voltage, and shortest time, that show anything about a battery.
_FEWEST_SAMPLES = 10
_SHORTEST_S = 120.0
#: A value that stays the same to the last digit for this time and number of samples may be that of a dead sensor,
_STUCK_S, _STUCK_SAMPLES = 120.0, 10
#: if meanwhile the voltage must have moved by this many of its smallest steps, or has moved by this many standard
#: deviations of its noise from sample to sample.
_MISSED_STEPS, _MOVED_STD = 5.0, 4.0
#: A steady current moves the voltage in its own direction. Noise moves it the other way, and so does the warming of the
#: battery, which lowers its overpotential by this share.
_WARMED = 0.3
#: A log whose sensor was stuck for this share of the time is set aside.
_MOSTLY = 0.5
#: Resistances may be lower than those of the file by this many standard deviations.
_LEAST_RESISTANCE_STD = 2.0


def usable_log(log: Log, battery: Battery) -> Log:
    """The log without the stretches in which a sensor was stuck, each with a note.

    Raises:
        InputError: nothing can be learnt from the log about this battery; says why.
    """
    _require_samples(log)
    require_followed(log)
    check_log(log, battery)
    if contradiction := other_cells(log, battery):
        raise InputError(f"{contradiction} Is it a log of another battery?")
    evidence = sign_evidence(log.time_s, log.current_A, log.voltage_V)
    for finding in check_current_sign(evidence, "log"):
        if finding.severity == "error":
            raise InputError(str(finding))
    log = _without_stuck_current(_without_stuck_voltage(log, battery), battery)
    log = _without(log, "current", moving_rests(log, battery), "did not show what charged or discharged the battery")
    log = _without(log, "current", hidden_charges(log, battery), HIDDEN_CHARGE)
    if log.temperature_degC is None:
        return log
    degC, notes = without_impossible(QUANTITIES["battery_temperature_degC"], log.temperature_degC, unit_known=True)
    if not notes:
        return log
    return replace(log, temperature_degC=degC if np.isfinite(degC).any() else None).with_notes(*notes)


def _require_samples(log: Log) -> None:
    """Raise InputError for a log that is too short, or lacks one of its quantities."""
    known = np.isfinite(log.current_A) & np.isfinite(log.voltage_V)
    if known.sum() < _FEWEST_SAMPLES or log.duration_s < _SHORTEST_S:
        raise InputError(
            f"only {known.sum()} samples with current and voltage in {log.duration_s:.3g} s; at least "
            f"{_FEWEST_SAMPLES} in {_SHORTEST_S:g} s are needed"
        )


def _without_stuck_voltage(log: Log, battery: Battery) -> Log:
    """The log without the voltages that stay the same to the last digit while the current out of the battery changes.

    A charger holds the voltage too, while its current falls.
    """
    known = log.voltage_V[np.isfinite(log.voltage_V)]
    least_V = _MISSED_STEPS * max(resolution(known), battery.noise.voltage_std_V / _MOVED_STD)
    moved_A = least_V / _least_resistance(battery)
    out_A = np.minimum(log.current_A, 0.0)
    stuck = [run for run in _constant(log, log.voltage_V) if _range(out_A[slice(*run)]) > moved_A]
    return _without(log, "voltage", stuck)


def _without_stuck_current(log: Log, battery: Battery) -> Log:
    """The log without the currents that stay the same to the last digit while the voltage jumps as under a load.

    Currents of a load or a charge against which the voltage moves are left out as well.
    """
    known = log.voltage_V[np.isfinite(log.voltage_V)]
    noise_V = max(battery.noise.voltage_std_V, resolution(known))
    jump_V = _MOVED_STD * np.sqrt(2.0) * noise_V
    constant = _constant(log, log.current_A)
    stuck = [
        (first, stop)
        for first, stop in constant
        if _rms_step(log.voltage_V[first:stop]) > jump_V
        or _against_V(log.voltage_V[first:stop], log.current_A[first], battery) > _MOVED_STD * noise_V
    ]
    return _without(log, "current", stuck)


def _against_V(voltage_V: np.ndarray, current_A: float, battery: Battery) -> float:
    """Voltage [V] by which a battery moves against its constant current, beyond the effect of warming; 0 at rest."""
    known = voltage_V[np.isfinite(voltage_V)]
    model = battery.thevenin
    if abs(current_A) <= REST_C * battery.capacity_Ah or known.size < 2 * MEDIAN_OF:
        return 0.0
    smooth = np.sign(current_A) * medians(known)
    against_V = float(np.max(np.maximum.accumulate(smooth) - smooth))
    return against_V - _WARMED * abs(current_A) * pulse_ohm(model)


def _constant(log: Log, values: np.ndarray) -> list[tuple[int, int]]:
    """First and end index of the long stretches in which a value stays the same to the last digit."""
    stretches = [(first, stop + 1) for first, stop in runs(np.diff(values) == 0.0)]
    return [
        (first, stop)
        for first, stop in stretches
        if stop - first >= _STUCK_SAMPLES and log.time_s[stop - 1] - log.time_s[first] >= _STUCK_S
    ]


def _without(log: Log, quantity: str, stuck: list[tuple[int, int]], fault: str = "was stuck") -> Log:
    """The log with NaN in the stretches, and a note.

    Raises:
        InputError: they are most of the log.
    """
    if not stuck:
        return log
    stuck_s = sum(float(log.time_s[stop - 1] - log.time_s[first]) for first, stop in stuck)
    hours = f"{stuck_s / SECONDS_PER_HOUR:.2g} of {log.duration_s / SECONDS_PER_HOUR:.2g} h"
    if stuck_s > _MOSTLY * log.duration_s:
        raise InputError(f"the sensor of the {quantity} {fault} for {hours}; check it and its column")
    name = {"voltage": "voltage_V", "current": "current_A"}[quantity]
    values = getattr(log, name).copy()
    for first, stop in stuck:
        values[first:stop] = np.nan
    note = Note(f"the sensor of the {quantity} {fault} for {hours}: left out", "warning")
    return replace(log, **{name: values}).with_notes(note)


def _least_resistance(battery: Battery) -> float:
    """Lowest ohmic resistance [ohm] that the file does not rule out."""
    model = battery.thevenin
    ohmic, pairs = np.median(model.r0_discharge_ohm), np.sum([np.median(ohm) for ohm in model.r_ohm])
    usual = float(ohmic or pairs)
    return max(usual, 1e-9) * float(np.exp(-_LEAST_RESISTANCE_STD * battery.noise.resistance_std))


def _range(values: np.ndarray) -> float:
    """Range of the values without the outermost hundredth on either side, which may be faults of single samples."""
    known = values[np.isfinite(values)]
    return float(np.ptp(np.quantile(known, [0.01, 0.99]))) if known.size else 0.0


def _rms_step(values: np.ndarray) -> float:
    """Root mean square of the change from sample to sample, the largest hundredth left out."""
    steps = np.abs(np.diff(values))
    steps = steps[np.isfinite(steps)]
    if not steps.size:
        return 0.0
    return float(np.sqrt(np.mean(steps[steps <= np.quantile(steps, 0.99)] ** 2)))
