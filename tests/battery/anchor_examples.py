"""Simulated charges, loads and rests whose state of charge is known, and batteries that know no more than the label."""

from dataclasses import replace

import numpy as np

from ohmward.battery.chemistries import generic_battery
from ohmward.logs.log import Log
from ohmward_lab.simulate import BATTERIES, resting_state, simulate
from ohmward_lab.simulate.profile import steps

HOUR = 3600.0


def day(chemistry, soc, phases, degC=25.0, interval_s=10.0, offset_C=0.0, limit_V=None):
    """Log and truth of phases (hours, multiples of the capacity per hour); limit_V: of the charger."""
    cell = BATTERIES[chemistry]
    cell = cell if limit_V is None else replace(cell, voltage_max_V=limit_V)
    capacity_Ah = cell.circuit.capacity_Ah
    profile = steps([(hours * HOUR, rate * capacity_Ah) for hours, rate in phases], degC)
    time_s = np.arange(0.0, profile.time_s[-1], interval_s)
    truth = simulate(cell, profile, time_s, resting_state(cell, soc, degC)).truth
    current_A = truth.current_A + offset_C * capacity_Ah
    return Log("day", time_s, current_A, truth.voltage_V, truth.temperature_degC), truth.soc


def label(chemistry):
    cell = BATTERIES[chemistry]
    return generic_battery(chemistry, cell.circuit.capacity_Ah, cell.n_series)


def drained(chemistry, rate, rest_hours=1.0, degC=25.0):
    """Log and truth of a load from 40 % until the protection cuts it off, and of the rest after it."""
    at_limit, _ = day(chemistry, 0.4, [(0.2, 0.0), (0.6 / rate, -rate)], degC, interval_s=2.0)
    reduced = at_limit.current_A > -0.999 * rate * label(chemistry).capacity_Ah
    cut_s = at_limit.time_s[np.argmax(reduced & (at_limit.time_s > 0.21 * HOUR))]
    return day(chemistry, 0.4, [(0.2, 0.0), (cut_s / HOUR - 0.2, -rate), (rest_hours, 0.0)], degC, interval_s=2.0)
