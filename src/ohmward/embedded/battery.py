"""Estimators of a battery file as C99 libraries."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Literal, get_args

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.models.ocv_on_lines import on_lines
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.soc.gaussian_sum import carries_errors
from ohmward.battery.soc.registry import ESTIMATORS, chosen_name, is_estimator, make_estimator, published, title_of
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.battery.soc.start_density import Hypothesis, InitialSoc
from ohmward.checks import require_one_of, require_positive
from ohmward.embedded.c_library import VECTORS, Export, VoltageStartPrograms
from ohmward.embedded.loops import EXAMPLE, textbook_loops
from ohmward.errors import InputError
from ohmward.filters.gate import choose
from ohmward.lab import lab
from ohmward.trace import isfinite, trace

#: The filter of the RC model's parameters, which does not estimate the state of charge.
JOINT = "textbook-joint"

#: The filters whose step can be written as loops.
WITH_LOOPS = ("textbook-ekf", "textbook-ukf", JOINT)

#: The filters that use the mean curve alone, which may then consist of straight lines.
WITH_LINES = ("textbook-ekf", "textbook-ukf")

#: State of charge at which a filter starts that takes none from the voltage.
_HALF_CHARGED = 0.5

Style = Literal["lines", "loops"]


def battery_export(
    battery: Battery,
    filter_name: str = "ekf",
    name: str = "battery",
    soc: float | None = None,
    soc_std: float = 0.3,
    sample_time_s: float | None = None,
    style: Style = "lines",
    curve_error_V: float | None = None,
) -> Export:
    """The estimator `filter_name` of a battery, or the filter JOINT of its RC model, ready to be written.

    filter_name: as for `SocEstimator`; "default" is the one that it uses.
    name: prefix of the symbols and files.
    soc, soc_std: of the start in C, in its test and README; estimators whose start cannot be traced always start there.
        None is an unknown one: nan where the start takes it from the first voltage, half charged elsewhere.
    sample_time_s: constant time between samples [s]: `dt_s` is not used, and the code is smaller. None for any time.
    style: "lines", a step without loops, the fastest; or "loops", the smallest, for the filters in WITH_LOOPS only.
    curve_error_V: largest error of the open-circuit voltage of a textbook filter, of the whole pack [V]: its curve
        becomes straight lines, and the table small. None keeps the curve.

    Raises:
        InputError: no such estimator or style of it, or the battery file lacks its model.
    """
    filter_name = chosen_name(filter_name)
    require_one_of("style", style, get_args(Style))
    if style == "loops" and filter_name not in WITH_LOOPS:
        raise InputError(f"{filter_name} has no loops, only {', '.join(WITH_LOOPS)} have; leave out --style loops")
    if filter_name == JOINT:
        if curve_error_V is not None:
            raise InputError(f"{JOINT} has no open-circuit voltage curve; leave out the curve error")
        return lab("published.joint_export").joint_export(battery, name, sample_time_s, style)
    if not is_estimator(filter_name):
        raise InputError(f"filter must be one of {', '.join((*ESTIMATORS, *published(), JOINT))}, got {filter_name!r}")
    title = f"State of charge of {battery.name}: {title_of(filter_name)}{interval_words(sample_time_s)}"
    if curve_error_V is not None:
        battery, error_V = _on_lines(battery, filter_name, curve_error_V)
        title += f", curve within {1e3 * error_V:.2g} mV"
    estimator: Any = make_estimator(filter_name, battery)
    if soc is None:
        soc = math.nan if carries_errors(estimator) else _HALF_CHARGED
    rest = SocSample(0.0, 0.0, usual_voltage(battery), ROOM_DEGC)
    state = estimator.init(rest, _HALF_CHARGED if math.isnan(soc) else soc, soc_std)
    at_rate = partial(at_fixed_rate, sample_time_s=sample_time_s)
    traceable = hasattr(estimator, "start")
    arguments = (soc, soc_std) if traceable else ()
    start = _started(estimator) if traceable else lambda sample: state
    return Export(
        name=name,
        title=title,
        step=trace(at_rate(estimator.step), state, EXAMPLE, with_origins=True),
        start=trace(start, EXAMPLE, *arguments, with_origins=True),
        flags=SocFlag,
        arguments=arguments,
        samples=vector_samples(battery),
        loops=textbook_loops(estimator, state, name, at_rate) if style == "loops" else None,
        start_note=_start_note(estimator) if traceable else "",
        voltage_start=_voltage_start(estimator) if hasattr(estimator, "voltage_start") else None,
    )


def _started(estimator: Any) -> Callable[..., Any]:
    """The start of an estimator, to be traced: from a given SoC, or where that is nan from the first voltage.

    The textbook filters, made for the least memory, only start from a given one.
    """
    if not carries_errors(estimator):
        return estimator.start

    def start(first: SocSample, soc: Any, soc_std: Any) -> Any:
        by_voltage = estimator.start_from(first, *estimator.voltage_start.on_coarse_grid(first))
        return choose(isfinite(soc), estimator.start(first, soc, soc_std), by_voltage)

    return start


def _start_note(estimator: Any) -> str:
    known = "`soc` (0 to 1) and `soc_std` (above 0) are the state of charge and its standard deviation"
    if carries_errors(estimator):
        return f"{known}; where `soc` is NAN, both come from the voltage of the sample: wait for one that has it."
    return f"{known}, which the first steps correct."


def _voltage_start(estimator: Any) -> VoltageStartPrograms:
    """The start of an estimator from the first voltage, traced."""
    start, part = estimator.voltage_start, Hypothesis(1.0, InitialSoc(0.5, 0.3))
    return VoltageStartPrograms(
        expected=trace(start.expected_voltage, 0.5, EXAMPLE),
        state=trace(estimator.start_from, EXAMPLE, *[part] * start.count),
    )


def curve_error_of_pack_V(battery: Battery, cell_mV: float | None) -> float | None:
    """The `curve_error_V` of a pack from the error of a cell [mV]; None stays None."""
    return None if cell_mV is None else 1e-3 * battery.n_series * cell_mV


def _on_lines(battery: Battery, filter_name: str, error_V: float) -> tuple[Battery, float]:
    """The battery with its curve as straight lines, and their largest error [V]; for the filters in WITH_LINES."""
    if filter_name not in WITH_LINES:
        raise InputError(
            f"{filter_name} needs the hysteresis and the temperature coefficient of the curve too; a curve "
            f"error is for {', '.join(WITH_LINES)}"
        )
    model = battery.thevenin
    ocv, found_V, _ = on_lines(model.ocv, error_V)
    return replace(battery, thevenin=replace(model, ocv=ocv)), found_V


def interval_words(sample_time_s: float | None) -> str:
    """The constant time between samples, for the title of an export; "" for any time."""
    return "" if sample_time_s is None else f", a step every {sample_time_s} s (`dt_s` is not used)"


def at_fixed_rate(step: Callable[..., Any], sample_time_s: float | None) -> Callable[..., Any]:
    """A function of state and sample with a constant time step; None leaves it unchanged."""
    if sample_time_s is None:
        return step
    require_positive("sample_time_s", sample_time_s)
    return lambda state, sample: step(state, sample._replace(dt_s=float(sample_time_s)))


def vector_samples(battery: Battery) -> np.ndarray:
    """Samples (T, 4) of the test vectors: a drive, a rest, charging, and faults of each sensor."""
    rng = np.random.default_rng(0)
    capacity = battery.capacity_Ah
    current = capacity * np.concatenate([rng.normal(-0.5, 0.5, VECTORS // 2), np.zeros(8), rng.uniform(0, 0.5, 24)])
    voltage = usual_voltage(battery) * (1.0 + 0.01 * rng.standard_normal(VECTORS)) + 0.002 * current / capacity
    samples = np.stack([np.ones(VECTORS), current, voltage, np.full(VECTORS, ROOM_DEGC)], axis=1)
    for row, column, value in _FAULTS:
        samples[row, column] = value
    samples[0, 0] = 0.0
    return samples


#: Row, column and value of faults of sensors and clock.
_FAULTS: tuple[tuple[int, int, Any], ...] = (
    (5, 1, math.nan),
    (9, 2, math.nan),
    (12, 3, math.nan),
    (15, 0, 0.0),
    (18, 0, -1.0),
    (21, 0, 3600.0),
    (24, 2, 0.0),
    (27, 1, 1e9),
    (30, 2, math.inf),
    (33, 0, math.nan),
)


def usual_voltage(battery: Battery) -> float:
    """Voltage at rest, half charged [V]."""
    return battery.thevenin.ocv.voltage_V[len(battery.thevenin.ocv.voltage_V) // 2]
