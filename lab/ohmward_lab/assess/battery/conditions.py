"""Conditions of the study: a base case, and each of its assumptions broken by itself, by a little and by much."""

from __future__ import annotations

from typing import NamedTuple

from ohmward_lab.assess.recommendation import Remedy, Situation


class Truth(NamedTuple):
    """State of the battery and of its surroundings, beside those of its test."""

    temperature_degC: float = 25.0  #: of the air
    #: of the battery over those when it was tested
    capacity_ratio: float = 1.0
    resistance_ratio: float = 1.0
    step_s: float = 1.0  #: between the instants of the simulation


class Condition(NamedTuple):
    """One condition. Shares are of the capacity in an hour (0.01 is 0.01 C), voltages of one cell."""

    #: in words
    factor: str
    level: str
    truth: Truth = Truth()  #: of the battery
    start_error: float | None = 0.05  #: of the initial value; None where it is unknown
    #: of the current sensor. The signs of these three alternate from run to run.
    offset_C: float = 0.005
    gain: float = 0.002
    #: standard deviations
    current_noise_C: float = 0.002
    voltage_noise_V: float = 0.001
    voltage_step_V: float = 0.0005  #: of the converter
    interval_s: float = 1.0  #: between samples
    missing: float = 0.0  #: share of the currents and of the voltages that are lost
    delay_s: float = 0.0  #: by which the voltage comes later than the current of the same row

    @property
    def name(self) -> str:
        """In tables and files."""
        return f"{self.factor}: {self.level}"


#: The base case: the battery as tested, a start a few points off, and an everyday sensor at 1 Hz.
BASE = Condition("base", "everyday sensors")

CONDITIONS: tuple[Condition, ...] = (
    BASE,
    Condition("laboratory", "right start, no offset", start_error=0.0, offset_C=0.0, gain=0.0),
    *(Condition("start", f"{100 * error:g} points off", start_error=error) for error in (0.1, 0.3)),
    Condition("start", "unknown", start_error=None),
    *(Condition("current offset", f"{100 * share:g} % of C", offset_C=share) for share in (0.02, 0.05)),
    *(Condition("current gain", f"{100 * share:g} %", gain=share) for share in (0.01, 0.03)),
    *(Condition("current noise", f"{100 * share:g} % of C", current_noise_C=share) for share in (0.02, 0.1)),
    *(Condition("voltage noise", f"{1e3 * volt:g} mV a cell", voltage_noise_V=volt) for volt in (0.005, 0.02)),
    *(Condition("voltage converter", f"{1e3 * volt:g} mV a cell", voltage_step_V=volt) for volt in (0.005, 0.02)),
    Condition("interval", "0.1 s", Truth(step_s=0.1), interval_s=0.1),
    *(Condition("interval", f"{seconds:g} s", interval_s=seconds) for seconds in (10.0, 60.0)),
    *(Condition("temperature", f"{degC:g} degC", Truth(degC)) for degC in (40.0, 5.0, -10.0)),
    *(Condition("capacity less", f"{100 * (1 - r):g} %", Truth(capacity_ratio=r)) for r in (0.95, 0.9)),
    Condition("age", "80 %, resistance x 1.5", Truth(capacity_ratio=0.8, resistance_ratio=1.5)),
    *(Condition("lost samples", f"{100 * share:g} %", missing=share) for share in (0.05, 0.3)),
    *(Condition("voltage late", f"{seconds:g} s", delay_s=seconds) for seconds in (1.0, 5.0)),
)

_SENSOR = ("base", "current noise", "voltage noise", "voltage converter", "lost samples")


def _as_in_the_base_case(name: str) -> tuple[Remedy, ...]:
    return (Remedy(name, (BASE.factor,)),)


SITUATIONS = (
    Situation("laboratory", ("laboratory",)),
    Situation(
        "everyday sensors, noisy or coarse", _SENSOR, (Remedy("sensor and start of the laboratory", ("laboratory",)),)
    ),
    Situation("the start is wrong or not known", ("start",), _as_in_the_base_case("a start that is right to 5 points")),
    Situation(
        "current sensor with offset and gain",
        ("current offset", "current gain"),
        _as_in_the_base_case("a better current sensor"),
    ),
    Situation(
        "samples seldom or out of step", ("interval", "voltage late"), _as_in_the_base_case("samples every second")
    ),
    Situation("cold or hot", ("temperature",), _as_in_the_base_case("a battery at 25 degC")),
    Situation(
        "less capacity than told, aged", ("capacity less", "age"), _as_in_the_base_case("a file of the aged battery")
    ),
)
