"""Episodes of slip: alarms at samples joined to the wheel, its start, its end and its largest slip."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.traction.speed_observer.conclusions import SlipAlarm
from ohmward.traction.speed_observer.estimator import SlipRun
from ohmward.traction.terrain.demand import travel_speed
from ohmward.traction.terrain.slip_on_floors import FloorRun

#: Alarms of a wheel that are no further apart [s] are one episode.
JOINED_S = 0.5
#: Sigmas above which 5 % of a normal distribution lie.
ONE_SIDED_95 = 1.645


class SlipEpisode(NamedTuple):
    """A time in which a wheel, or the robot as a whole, slipped more than is allowed."""

    wheel: str  #: its name, or "robot"
    #: of the alarm, on the log's clock
    start_s: float
    end_s: float
    greatest_slip_m_s: float  #: slip speed r omega - v of the largest size in it
    greatest_slip: float  #: slip ratio of the largest size, nan below the floor of speed


class ImmobilisedEpisode(NamedTuple):
    """The wheels turned and the robot did not, from start_s to end_s on the log's clock."""

    start_s: float
    end_s: float


def slip_episodes(track: SlipRun, wheels: Sequence[str]) -> list[SlipEpisode]:
    """Slip episodes in order of time; wheels: names of the driven wheels."""
    found = []
    for k, wheel in enumerate(wheels):
        speed, ratio = track.estimates.slip_speed_m_s[:, k], track.estimates.slip_ratio[:, k]
        for first, last in _joined_runs(track.time_s, track.estimates.slipping[:, k] > 0.5):
            part = slice(first, last + 1)
            start_s, end_s = float(track.time_s[first]), float(track.time_s[last])
            found.append(SlipEpisode(wheel, start_s, end_s, _greatest(speed[part]), _greatest(ratio[part])))
    return sorted(found, key=lambda episode: episode.start_s)


def robot_episodes(track: FloorRun) -> list[SlipEpisode]:
    """Episodes in which a robot on learnt floors loses more than is allowed of the way of its wheels, for 95 % sure."""
    slip, std = np.nan_to_num(track.travel_slip), np.nan_to_num(track.travel_slip_std)
    speed = slip * travel_speed(track.rim)
    alarm = slip - SlipAlarm().allowed_ratio > ONE_SIDED_95 * std
    return [
        SlipEpisode(
            "robot",
            float(track.time_s[first]),
            float(track.time_s[last]),
            _greatest(speed[first : last + 1]),
            _greatest(slip[first : last + 1]),
        )
        for first, last in _joined_runs(track.time_s, alarm)
    ]


def immobilised_episodes(track: SlipRun) -> list[ImmobilisedEpisode]:
    """Times in which the robot was stuck, in order."""
    episodes = _joined_runs(track.time_s, track.estimates.immobilised > 0.5)
    return [ImmobilisedEpisode(float(track.time_s[first]), float(track.time_s[last])) for first, last in episodes]


def _joined_runs(time_s: np.ndarray, alarm: np.ndarray) -> list[tuple[int, int]]:
    """First and last sample of every stretch of alarms (T,), short pauses bridged."""
    at = np.flatnonzero(alarm)
    if not at.size:
        return []
    pauses = np.flatnonzero(np.diff(time_s[at]) > JOINED_S)
    first, last = np.append(0, pauses + 1), np.append(pauses, at.size - 1)
    return [(int(at[a]), int(at[b])) for a, b in zip(first, last, strict=True)]


def _greatest(values: np.ndarray) -> float:
    """The value of the largest size; nan where there is none."""
    known = values[np.isfinite(values)]
    return float(known[np.argmax(np.abs(known))]) if known.size else float("nan")
