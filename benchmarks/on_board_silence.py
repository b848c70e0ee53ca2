"""Silence of sensors at random moments of simulated drives: is the truth in the bands of what is passed on later?"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward import generic_battery
from ohmward.filters.consistency import BAND_95
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.message import Message
from ohmward.onboard.page.view import ELLIPSE_95
from ohmward.onboard.process import Process
from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.sources.simulation import SimulationSource
from ohmward.traction.robot.packaged import RLMA
from ohmward_lab.onboard.simulated_robot import demonstration, signals_of
from ohmward_lab.simulate.closed_loop import Pack
from ohmward_lab.simulate.closed_loop.loop import ClosedLoopDrive
from ohmward_lab.simulate.closed_loop.run import RunRow
from ohmward_lab.simulate.robot_sensors import stack

#: After so long a silence [s] the bands are looked at.
AGES_S = (1.0, 10.0, 600.0)

#: A drive is watched from so long before a silence [s].
BEFORE_S = 30.0

#: Silences of each drive, and the length in which they begin [s].
SILENCES, BEGIN_WITHIN_S = 20, 60.0

#: Every sensor falls silent with this probability, and all do together with the second.
ONE, ALL = 0.5, 0.3


class Silence(NamedTuple):
    """States after a silence: is each quantity that is passed on within its band? None where it is unknown."""

    age_s: float
    covered: dict[str, bool | None]


def silences(drives: int) -> Iterator[Silence]:
    """Silences of subsets of the sensors at random moments of so many drives."""
    random = np.random.default_rng(32)
    for k in range(drives):
        scenario = replace(demonstration(100 + k), battery=Pack("lfp", float(random.uniform(0.3, 0.9))))
        rows = drive_of(scenario, BEFORE_S + BEGIN_WITHIN_S + AGES_S[-1])
        signals = signals_of(rows, [place.name for place in RLMA.places])
        times_s = signals.pop("time_s")
        measured = {name: column for name, column in signals.items() if np.isfinite(column).any()}
        for _ in range(SILENCES):
            silent = set(measured) if random.random() < ALL else {n for n in measured if random.random() < ONE}
            begin = int(np.searchsorted(times_s, random.uniform(0.0, BEGIN_WITHIN_S)))
            yield from after_silence(times_s, measured, rows, begin, silent)


def drive_of(scenario: object, seconds: float) -> RunRow:
    """The rows of a simulated drive."""
    drive = ClosedLoopDrive(scenario)
    while drive.truth.time_s < seconds:
        drive.step()
    return stack(drive.rows)


def after_silence(
    times_s: np.ndarray, measured: dict[str, np.ndarray], rows: RunRow, begin: int, silent: set[str]
) -> Iterator[Silence]:
    """What is passed on after each age, sensors silent from `BEFORE_S` after the row `begin` on."""
    process = Process(Estimation(generic_battery("lfp", 12.0, 4), RLMA), [SimulationSource(name="robot")], [])
    silent_s = times_s[begin] + BEFORE_S
    ages = list(AGES_S)
    for k in range(begin, len(times_s)):
        time_s = float(times_s[k])
        values = {name: float(column[k]) for name, column in measured.items() if math.isfinite(column[k])}
        if time_s >= silent_s:
            values = {name: value for name, value in values.items() if name not in silent}
        process.put(Message(time_s, time_s, "robot", values))
        if time_s >= silent_s + ages[0]:
            process._pass_on(process.estimation.state._replace(time_s=time_s, sample={}))
            yield Silence(ages.pop(0), covered(process.state, rows, begin, k))
        if not ages:
            return


def covered(state: RobotState, rows: RunRow, begin: int, now: int) -> dict[str, bool | None]:
    """Is the truth within the band, of each quantity that is passed on?"""
    found: dict[str, bool | None] = dict.fromkeys(("charge", "speed", "position"))
    if state.battery:
        found["charge"] = abs(state.battery.soc - rows.soc[now]) <= BAND_95 * state.battery.soc_std
    if state.slip:
        found["speed"] = abs(state.slip.speed_m_s - rows.truth.speed_m_s[now]) <= BAND_95 * state.slip.speed_std_m_s
    if state.pose:
        moved = rows.truth.position_m[now][:2] - rows.truth.position_m[begin][:2]
        c, s = math.cos(rows.truth.heading_rad[begin]), math.sin(rows.truth.heading_rad[begin])
        error = np.array([c * moved[0] + s * moved[1], c * moved[1] - s * moved[0]]) - [state.pose.x_m, state.pose.y_m]
        found["position"] = bool(error @ np.linalg.solve(state.pose.pose_cov[:2, :2], error) <= ELLIPSE_95**2)
    return found


def shares(found: Sequence[Silence]) -> Iterator[tuple[float, str, float, float]]:
    """Age, quantity, share of the truths within their bands or unknown, and share of the unknown."""
    for age_s in AGES_S:
        of_age = [silence.covered for silence in found if silence.age_s == age_s]
        for quantity in of_age[0]:
            counts = Counter(covered[quantity] for covered in of_age)
            yield age_s, quantity, 1.0 - counts[False] / len(of_age), counts[None] / len(of_age)
