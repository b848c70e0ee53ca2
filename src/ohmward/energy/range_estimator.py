"""Stateful range estimator: `update` takes live samples, `run` takes a whole log."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, Self, get_type_hints

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.soc.clean_sample import is_temperature, sample_limits
from ohmward.battery.soc.estimator import SocRun
from ohmward.battery.soc.sample import SocEstimate
from ohmward.energy.consumption import Consumption, begin_drive, start
from ohmward.energy.consumption_file import dump_consumption, parse_consumption
from ohmward.energy.consumption_prior import prior_from_robot
from ohmward.energy.cut_drive import DriveSample
from ohmward.energy.leg import Leg
from ohmward.energy.points import Quantiles
from ohmward.energy.range_step import (
    RangeEstimate,
    RangeFlag,
    RangeSample,
    RangeSettings,
    RangeState,
    SocNow,
    WayHome,
)
from ohmward.errors import InputError
from ohmward.filters.estimator import Progress, number
from ohmward.filters.run import Run
from ohmward.logs.log import Log, LogSource, as_log
from ohmward.quantities import FASTEST_M_S
from ohmward.trace import snapshot
from ohmward.traction.robot.packaged import load_robot
from ohmward.traction.robot.robot import Robot

#: A state of charge outside [0, 1] by no more than this is rounded; farther outside it is none.
ROUNDED_SOC = 0.05
#: An estimate may overshoot while it settles; farther from half charge than this it is none.
MOST_OVERSHOOT = 1.0
#: Credible capacity and resistance, relative to the file's.
CREDIBLE_RATIO = 0.05, 20.0
#: Longest credible way home [m].
LONGEST_M = 1e7


def _settings(battery: Battery, options: Mapping[str, Any]) -> RangeSettings:
    """The settings from options; InputError for an unknown option."""
    known = [field.name for field in fields(RangeSettings) if field.name != "battery"]
    if unknown := [name for name in options if name not in known]:
        raise InputError(f"RangeEstimator has no option {unknown[0]!r}; it has {', '.join(known)}")
    return RangeSettings(battery, **options)


class RangeRun(Run[RangeEstimate]):
    """Range along a whole log; every field (T,), quantiles as three columns."""

    flag_type = RangeFlag


class RangeEstimator:
    """Distance and time left with the battery, and the probability of getting home; live or from logs.

    >>> estimator = ow.RangeEstimator(ow.load_battery("battery.toml"), ow.load_consumption("table.toml"))
    >>> now = estimator.update(0.0, soc=0.8, speed_m_s=0.5, current_A=-2.1, voltage_V=13.1)
    >>> now.distance_m.p10 < now.distance_m.p50 < now.distance_m.p90
    True

    A forecast takes as long as thousands of samples, so it is renewed every `refresh_s` and held in between.

    Args:
        battery: identified or generic.
        consumption: as learned before this drive; for the first drive a robot, or the path or name of one, from
            which a broad prior is made.
        days: number of days since the last drive in the consumption.
        options: see `RangeSettings`: terrain, reserve_soc, cutoff_V, payload_kg, refresh_s.
    """

    def __init__(self, battery: Battery, consumption: Consumption | Robot | str, days: float = 0.0, **options: Any):
        if not isinstance(consumption, Consumption):
            robot = consumption if isinstance(consumption, Robot) else load_robot(consumption)
            consumption = start(prior_from_robot(robot))
        self.settings = _settings(battery, options)
        self.state = self.settings.init(begin_drive(consumption, days))

    @classmethod
    def restore(cls, battery: Battery, snapshot: Mapping[str, Any], **options: Any) -> Self:
        """The estimator that continues from a snapshot; options: those of the estimator that took it.

        Raises:
            InputError: the snapshot is of another version, another battery or other settings, or damaged.
        """
        estimator = object.__new__(cls)
        estimator.settings = _settings(battery, options)
        estimator.state = _state_of(estimator.settings, snapshot)
        return estimator

    @property
    def consumption(self) -> Consumption:
        """Consumption as learned, this drive included; `save_consumption` stores it for the next one."""
        return self.state.consumption

    @property
    def time_s(self) -> float:
        """Time of the last sample; nan before the first."""
        return self.state.meter.last.time_s if self.state.meter.last else math.nan

    def change_battery(self) -> None:
        """Reset the battery's state after a change to another one of its kind; the record of the drive is kept."""
        nothing = self.settings.init(replace(self.consumption, end=None))
        self.state = self.state._replace(
            consumption=nothing.consumption,
            soc=nothing.soc,
            forecast=nothing.forecast,
            forecast_s=nothing.forecast_s,
            discharge=nothing.discharge,
            sag=nothing.sag,
        )

    def update(
        self,
        time_s: float,
        soc: float | SocEstimate | None,
        speed_m_s: float | None = None,
        current_A: float | None = None,
        voltage_V: float | None = None,
        grade_rad: float | None = 0.0,
        terrain: str | None = None,
        home: WayHome = None,
        temperature_degC: float | None = None,
        plan: Sequence[Leg] = (),
    ) -> RangeEstimate:
        """Range after one live sample; None and nan are missing values.

        time_s: of the sample; a late one is flagged and not used for the drive.
        soc: the result of `SocEstimator.update`, or a number in [0, 1] that is assumed exact; one outside by more than
            0.05 is missing.
        speed_m_s: of the body, forward.
        current_A, voltage_V: of the battery; current > 0 charges.
        grade_rad: > 0 with the nose up.
        terrain: name of the ground; None is that of the settings.
        home: length of the way home [m], back over ground like the recent one without its stays, or its legs.
        temperature_degC: of the battery.
        plan: the legs ahead, nearest first, as far as they are known; beyond them the ground is like the recent one.

        Raises:
            InputError: anything but numbers.
        """
        amperes, volts = number("current_A", current_A), number("voltage_V", voltage_V)
        limits = sample_limits(self.settings.battery.thevenin)
        if not (limits.is_current(amperes) and limits.is_voltage(volts)):
            amperes = volts = math.nan
        drive = DriveSample(
            _credible(number("time_s", time_s), -snapshot.LARGEST, snapshot.LARGEST),
            _credible(number("speed_m_s", speed_m_s), -FASTEST_M_S, FASTEST_M_S),
            -amperes * volts,
            number("grade_rad", grade_rad),
            terrain or self.settings.terrain,
        )
        now = soc_now(soc, number("temperature_degC", temperature_degC))
        way = home
        if not isinstance(home, Sequence):
            length_m = number("home", home)
            way = length_m if 0.0 <= length_m <= LONGEST_M else None
        self.state, estimate = self.settings.step(self.state, RangeSample(drive, now, way, amperes, volts, plan))
        return estimate

    def run(
        self,
        log: LogSource,
        soc: SocRun | np.ndarray,
        speed_m_s: np.ndarray | str = "speed_m_s",
        grade_rad: np.ndarray | str | None = None,
        terrain: Sequence[str] | str | None = None,
        home: np.ndarray | WayHome = None,
        progress: Progress | None = None,
    ) -> RangeRun:
        """Range at every sample of a log of the battery, continuing from this estimator's state.

        log: a Log, or a path or DataFrame of one.
        soc: the result of `SocEstimator.run` for the log, or (T,) in [0, 1].
        speed_m_s, grade_rad: (T,), or the name of a further column of the log.
        terrain: name of the ground under each sample, or one for all.
        home: length of the way home [m], (T,) or one for all; or its legs.
        progress: called now and then with (steps done, T).

        Raises:
            InputError: a column that is missing or of another length, or a state of charge in percent.
        """
        began = time.perf_counter()
        log = as_log(log)
        T = len(log)
        if isinstance(soc, SocRun):
            socs: Any = [SocEstimate(*row) for row in zip(*soc.estimates, strict=True)]
        else:
            socs = _column(log, "soc", soc)
            known = socs[np.isfinite(socs)]
            usual = float(np.median(known)) if known.size else 0.0
            if not _is_share(usual):
                raise InputError(f"soc must be between 0 and 1 (0.8 is 80 %), got {usual:g}")
        columns: dict[str, Any] = {
            "time_s": log.time_s,
            "soc": socs,
            "speed_m_s": _column(log, "speed_m_s", speed_m_s),
            "current_A": log.current_A,
            "voltage_V": log.voltage_V,
            "grade_rad": np.zeros(T) if grade_rad is None else _column(log, "grade_rad", grade_rad),
            "terrain": [terrain] * T if terrain is None or isinstance(terrain, str) else terrain,
            "home": home if isinstance(home, np.ndarray) else [home] * T,
            "temperature_degC": [None] * T if log.temperature_degC is None else log.temperature_degC,
        }
        for name, values in columns.items():
            if len(values) != T:
                raise InputError(f"{name} must have {T} values, one for each sample of the log, got {len(values)}")
        estimates = []
        for row in zip(*columns.values(), strict=True):
            estimates.append(self.update(*row))
            if progress:
                progress(len(estimates), T)
        return RangeRun(log.time_s, _along(estimates), time.perf_counter() - began)

    def snapshot(self) -> dict[str, Any]:
        """The state as a dict for JSON; an estimator with the same settings continues from it bit for bit.

        Raises:
            InputError: there is no state before the first sample.
        """
        if self.state.meter.last is None:
            raise InputError("there is nothing to take a snapshot of before the first sample; call update or run first")
        state = self.state._replace(consumption=dump_consumption(self.consumption))  # type: ignore[arg-type]
        content = {"estimator": snapshot.identity(self.settings), "time_s": self.time_s, "state": _plain(state)}
        return snapshot.sealed(content)

    def __repr__(self) -> str:
        battery, reach = self.settings.battery, self.state.forecast.distance_m
        left = "" if math.isnan(reach.p50) else f", {reach.p50:.0f} m left ({reach.p10:.0f} to {reach.p90:.0f})"
        return f"RangeEstimator({battery.chemistry or battery.name} {battery.capacity_Ah:g} Ah{left})"


def soc_now(soc: float | SocEstimate | None, temperature_degC: float) -> SocNow:
    """State of the battery from an estimate, or from a number that is assumed exact."""
    if not is_temperature(temperature_degC):
        temperature_degC = math.nan
    if not isinstance(soc, SocEstimate):
        value = number("soc", soc)
        return SocNow(min(max(value, 0.0), 1.0) if _is_share(value) else math.nan, temperature_degC=temperature_degC)
    is_known = abs(soc.soc - 0.5) <= MOST_OVERSHOOT and 0.0 <= soc.soc_std <= 1.0
    return SocNow(
        min(max(float(soc.soc), 0.0), 1.0) if is_known else math.nan,
        float(soc.soc_std),
        _credible(soc.soh_capacity, *CREDIBLE_RATIO),
        _credible(soc.soh_capacity_std, 0.0, CREDIBLE_RATIO[1]),
        _credible(soc.resistance_ratio, *CREDIBLE_RATIO),
        _credible(soc.resistance_ratio_std, 0.0, CREDIBLE_RATIO[1]),
        temperature_degC,
    )


def _credible(value: float, least: float, most: float) -> float:
    return float(value) if least <= value <= most else math.nan


def _is_share(soc: float) -> bool:
    return -ROUNDED_SOC <= soc <= 1.0 + ROUNDED_SOC


def _column(log: Log, name: str, values: np.ndarray | str) -> np.ndarray:
    """A column as given, or from the log by its name."""
    if not isinstance(values, str):
        return np.asarray(values, dtype=float)
    if values not in log.extra:
        has = ", ".join(log.extra) or "nothing but the battery"
        raise InputError(f"log {log.name!r} has no column {values!r} for {name}, but {has}; name one, or give an array")
    return log.extra[values]


def _along(estimates: Sequence[RangeEstimate]) -> RangeEstimate:
    """Single estimates combined into one of arrays (T,)."""
    columns: list[Any] = []
    for values in zip(*estimates, strict=True):
        if isinstance(values[0], Quantiles):
            columns.append(Quantiles(*np.array(values, dtype=float).T))
        else:
            columns.append(np.array(values, dtype=float))
    return RangeEstimate(*columns)


def _plain(value: Any) -> Any:
    """Tuples as lists for JSON, which has neither NaN nor infinity: those become text."""
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    return int(value) if isinstance(value, RangeFlag) else value


#: Types of the state as `_plain` writes it.
_FORECAST = tuple[Quantiles, Quantiles, Quantiles, Quantiles, float, float, int]
_FIELDS = get_type_hints(RangeState) | {"consumption": str, "forecast": _FORECAST}
_STATE: Any = tuple[tuple(_FIELDS.values())]  # type: ignore[misc]


def _state_of(settings: RangeSettings, taken: Mapping[str, Any]) -> RangeState:
    """The state from a snapshot."""
    snapshot.require_version(taken)
    snapshot.require_identity(settings, taken)
    snapshot.require_seal(taken)
    table, *others = snapshot.typed(_STATE, "state", taken.get("state"), strict=False)
    state = RangeState(parse_consumption(table), *others)
    forecast = RangeEstimate(*state.forecast)
    return state._replace(forecast=forecast._replace(flags=RangeFlag(forecast.flags)))
