"""Inbox of a robot: turns messages of sensors at different rates, late and out of order, into samples in order.

A message waits for `delay_s`, until no earlier one can arrive. A sample ends with the wheel speeds and includes what
other sensors have sent since the previous sample: the mean motor currents, yaw rate and acceleration over the step, the
newest value of everything else, and the age of an external speed. If no wheel reports, samples continue without wheels.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence
from itertools import count
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_positive
from ohmward.errors import InputError
from ohmward.filters.estimator import CLOCK_SET_S, PerWheel, number, numbers
from ohmward.quantities import BODY
from ohmward.traction.motion.sample import SHORTER
from ohmward.traction.robot.chassis import Steered
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.encoders import differences

#: Body sensors that the odometry uses and the speed observer does not.
HEADING = ("heading_rad", "heading_std_rad")
_BODY = frozenset(BODY)
#: Rates: their mean over a step gives the change in it, their newest value would turn a vibration into a slow change.
_RATES = frozenset({"yaw_rate_rad_s", "acceleration_m_s2"})
#: Share of the usual interval of counts below which one is part of a burst, and largest factor by which one gap between
#: two lengthens that interval: the first gap may be one within a burst.
BURST, LONGER_COUNT = 1.0 / 3.0, 2.0
#: Arguments of `SensorInbox.put` that have a value for each wheel or motor.
WHEELS = ("wheel_speed_rad_s", "wheel_counts", "current_A")


class _Message(NamedTuple):
    """Measured values of a message, as floats: for so few they are much faster than arrays.

    speeds, counts: by wheel number. currents: (driven,) or empty.
    """

    stamp_s: float
    speeds: dict[int, float]
    counts: dict[int, float]
    currents: list[float]
    body: Mapping[str, float]


class _Count(NamedTuple):
    """Last count of a wheel, and its usual interval [s]; 0 before the second one."""

    stamp_s: float
    counted: int
    usual_s: float = 0.0


class SensorInbox:
    """Messages in, samples out.

    >>> inbox = SensorInbox(robot, delay_s=0.02)                                                     # doctest: +SKIP
    >>> inbox.put(0.010, current_A=[1.2, 1.1])                                                       # doctest: +SKIP
    >>> inbox.put(0.012, wheel_counts=[4711, 4698])                                                  # doctest: +SKIP
    >>> for sample in inbox.take(): estimator.update(**sample)                                       # doctest: +SKIP

    Args:
        robot: robot that carries the sensors.
        delay_s: longest time by which a message may arrive after one with a later stamp, >= 0; later ones are left out.
        gather_s: speeds of single wheels with stamps at most this far apart form one sample, >= 0.
        silence_s: time without a wheel report after which a sample without wheels is made, > 0.
        counts_per_turn: of the encoders; needed for `wheel_counts`.
        bits: width of their counters, which wrap around.
        prompt: close a sample as soon as every wheel that usually reports has done so, instead of with the next one;
            late messages then go with the next sample, wheel speeds only within `gather_s`. Wheel speeds stamped after
            the previous sample form a sample of their own time, even if other sensors have already sent later messages.

    Attributes:
        left_out: number of messages that came too late, or whose stamp was not finite or far from all others.
    """

    def __init__(
        self,
        robot: Robot,
        delay_s: float = 0.05,
        gather_s: float = 0.002,
        silence_s: float = 0.25,
        counts_per_turn: float | None = None,
        bits: int = 32,
        prompt: bool = False,
    ):
        require_between("delay_s", delay_s, 0.0, math.inf)
        require_between("gather_s", gather_s, 0.0, math.inf)
        require_positive("silence_s", silence_s)
        self.delay_s, self.gather_s, self.silence_s = delay_s, gather_s, silence_s
        self.counts_per_turn, self.bits = counts_per_turn, bits
        self.prompt = prompt
        self.left_out = 0
        self._wheels, self._driven = len(robot.places), robot.driven
        self._steers = isinstance(robot.chassis, Steered)
        self._waiting: list[tuple[float, int, _Message]] = []
        self._order = count()
        self._newest_s = self._taken_s = -math.inf
        self._odd_s = math.nan
        self._before_clock_set: list[dict[str, Any]] = []
        self._counts: dict[int, _Count] = {}
        self._start_s = self._sample_s = self._speed_s = math.nan
        self._reported_s: dict[int, float] = {}
        self._speeds: dict[int, float] = {}
        self._currents: list[list[float]] = []
        self._rates: dict[str, list[float]] = {}
        self._body: dict[str, float] = {}
        #: Last steering angle and its stamp.
        self._steering = (math.nan, -math.inf)

    def put(
        self,
        stamp_s: float,
        *,
        wheel_speed_rad_s: PerWheel | None = None,
        wheel_counts: PerWheel | None = None,
        current_A: PerWheel | None = None,
        **body: float | None,
    ) -> None:
        """Take in a message.

        stamp_s: time of its measurement.
        wheel_speed_rad_s, wheel_counts: (wheels,) or (driven,), nan or None for wheels without a value; of a steered
            robot that has only one, in the place of the first. Its steering angle holds for `silence_s`.
        current_A: (driven,), likewise.
        body: any of `BODY`.

        Raises:
            InputError: values that are not numbers, the wrong number of wheels, or an unknown name.
        """
        stamp_s = number("stamp_s", stamp_s)
        if not body.keys() <= _BODY:
            unknown = [name for name in body if name not in BODY]
            raise InputError(f"a message has no {', '.join(unknown)}; there are {', '.join(BODY)}")
        if wheel_counts is not None and self.counts_per_turn is None:
            raise InputError("wheel_counts need counts_per_turn of the inbox; give it, or put speeds")
        wheels = self._wheels, self._driven
        message = _Message(
            stamp_s,
            _measured("wheel_speed_rad_s", wheel_speed_rad_s, *wheels),
            _measured("wheel_counts", wheel_counts, *wheels),
            [] if current_A is None else numbers("current_A", current_A, self._driven).tolist(),
            {name: number(name, value) for name, value in body.items()},
        )
        of_wheels = message.speeds or message.counts
        latest_s = (self.gather_s if of_wheels else self.silence_s) if self.prompt else 0.0
        if self._is_odd(stamp_s):
            self.left_out += 1
            return
        in_open_sample = self.prompt and of_wheels and stamp_s > self._start_s
        if not in_open_sample and not stamp_s >= self._taken_s - latest_s:
            self.left_out += 1
            return
        self._newest_s = max(self._newest_s, stamp_s)
        taken_at_s = stamp_s if in_open_sample else max(stamp_s, self._taken_s)
        heapq.heappush(self._waiting, (taken_at_s, next(self._order), message))

    def take(self) -> list[dict[str, Any]]:
        """Completed samples in order, each as keyword arguments of `SlipEstimator.update`.

        Values of `HEADING`, if any were put in, are for `Odometry.update` only.
        """
        done, self._before_clock_set = self._before_clock_set, []
        return [*done, *self._take(self._newest_s - self.delay_s)]

    def flush(self) -> list[dict[str, Any]]:
        """All remaining samples, at the end of a drive."""
        done, self._before_clock_set = self._before_clock_set, []
        return [*done, *self._take(math.inf), *self._close()]

    def _is_odd(self, stamp_s: float) -> bool:
        """True for a stamp not finite or over `CLOCK_SET_S` from the others; two such in a row set the clock."""
        if not math.isfinite(stamp_s):
            return True
        if math.isinf(self._newest_s) or abs(stamp_s - self._newest_s) <= CLOCK_SET_S:
            self._odd_s = math.nan
            return False
        if not abs(stamp_s - self._odd_s) <= CLOCK_SET_S:
            self._odd_s = stamp_s
            return True
        self._before_clock_set = self.flush()
        self._newest_s = self._taken_s = -math.inf
        self._counts, self._reported_s, self._odd_s = {}, {}, math.nan
        self._clear(math.nan)
        return False

    def _take(self, until_s: float) -> list[dict[str, Any]]:
        samples: list[dict[str, Any]] = []
        while self._waiting and self._waiting[0][0] <= until_s:
            stamp_s, _, message = heapq.heappop(self._waiting)
            self._taken_s = max(self._taken_s, stamp_s)
            speeds = self._speeds_of(stamp_s, message)
            if self._is_over(stamp_s, speeds):
                samples += self._close()
            self._add(stamp_s, speeds, message)
            if self.prompt and speeds and self._all_have_reported():
                samples += self._close()
        return samples

    def _all_have_reported(self) -> bool:
        """True where the sample has the speeds of all wheels that have reported within `silence_s`."""
        since_s = self._sample_s - self.silence_s
        return all(wheel in self._speeds for wheel, at_s in self._reported_s.items() if at_s > since_s)

    def _speeds_of(self, stamp_s: float, message: _Message) -> dict[int, float]:
        """Speeds [rad/s] in a message by wheel; counts give the mean since the wheel's previous count.

        A count sooner than usual is one of a burst, measured before it arrived; the next one contains its turn.
        """
        if not message.counts:
            return message.speeds
        speeds = dict(message.speeds)
        for wheel, counted in message.counts.items():
            last = self._counts.setdefault(wheel, _Count(stamp_s, int(counted)))
            since_s = stamp_s - last.stamp_s
            if since_s > BURST * last.usual_s:
                (turned,) = differences(np.array([[last.counted], [int(counted)]]), self.bits)[:, 0]
                speeds[wheel] = 2 * math.pi * turned / self.counts_per_turn / since_s
                followed_s = min(max(since_s, SHORTER * last.usual_s), LONGER_COUNT * last.usual_s)
                self._counts[wheel] = _Count(stamp_s, int(counted), followed_s or since_s)
        return speeds

    def _is_over(self, stamp_s: float, speeds: Mapping[int, float]) -> bool:
        """True where a message belongs to the next sample."""
        if self._speeds:
            return stamp_s > self._sample_s + self.gather_s or any(wheel in self._speeds for wheel in speeds)
        return stamp_s > self._start_s + self.silence_s

    def _add(self, stamp_s: float, speeds: Mapping[int, float], message: _Message) -> None:
        """Add a message to the open sample."""
        if math.isnan(self._start_s):
            self._start_s = stamp_s
        if not self._speeds:
            self._sample_s = stamp_s
        elif speeds:
            self._sample_s = max(self._sample_s, stamp_s)
        self._speeds.update(speeds)
        for wheel in speeds:
            self._reported_s[wheel] = stamp_s
        if any(map(math.isfinite, message.currents)):
            self._currents.append(message.currents)
        for name, value in message.body.items():
            if math.isfinite(value) and name in _RATES:
                self._rates.setdefault(name, []).append(value)
            elif math.isfinite(value):
                self._body[name] = value
                if name == "steering_rad":
                    self._steering = value, message.stamp_s
                if name == "speed_m_s":
                    self._speed_s = message.stamp_s

    def _close(self) -> list[dict[str, Any]]:
        """Close the open sample and return it unless it is empty; the next one begins where it ends."""
        if not (self._speeds or self._currents or self._rates or self._body):
            return []
        speeds = np.array([self._speeds.get(wheel, math.nan) for wheel in range(self._wheels)])
        sample: dict[str, Any] = {"time_s": self._sample_s, "wheel_speed_rad_s": speeds, **self._body}
        sample |= {name: _mean(values) for name, values in self._rates.items()}
        if self._currents:
            sample["current_A"] = np.array([_mean(column) for column in zip(*self._currents, strict=True)])
        sample.pop("steering_rad", None)
        if self._steers and abs(self._sample_s - self._steering[1]) < self.silence_s:
            sample["steering_rad"] = self._steering[0]
        if "speed_m_s" in sample:
            waited_s = max(self._sample_s - self._speed_s, 0.0)
            sample["speed_age_s"] = waited_s + self._body.get("speed_age_s", 0.0)
        self._clear(self._sample_s)
        return [sample]

    def _clear(self, start_s: float) -> None:
        """Begin an empty sample at `start_s`."""
        self._start_s = self._sample_s = start_s
        self._speeds, self._currents, self._rates, self._body = {}, [], {}, {}
        self._speed_s = math.nan


def _measured(name: str, values: PerWheel | None, *counts: int) -> dict[int, float]:
    """Finite values by wheel; raises InputError like `numbers`."""
    if values is None:
        return {}
    given = numbers(name, values, *counts).tolist()
    return {wheel: value for wheel, value in enumerate(given) if math.isfinite(value)}


def _mean(values: Sequence[float]) -> float:
    """Mean of the finite values; nan if there are none."""
    known = [value for value in values if math.isfinite(value)]
    return sum(known) / len(known) if known else math.nan
