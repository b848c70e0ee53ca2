"""Checks of one signal, with one wording for each fault wherever it is found.

A check takes the values of a signal, from a whole log or the last seconds of a running robot, and the limits plausible
for battery and robot. It reports the fault and the fix, which in the setup of a robot is another key than for a log.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

from ohmward.quantities import Quantity, ValueLimits

Severity = Literal["error", "warning", "info"]

#: Where a fault is corrected: in the setup of a robot, or by the options with which a log is read.
Place = Literal["setup", "log"]


@dataclass(frozen=True)
class Finding:
    """One thing that was noticed, and the advice that goes with it; an error makes results wrong."""

    severity: Severity
    text: str
    advice: str

    def __str__(self) -> str:
        return f"{self.text}; {self.advice}"


class Scale(NamedTuple):
    """A unit that is often forgotten: its factor to the quantity's unit, its name, and its symbol for `--unit`."""

    factor: float
    name: str
    symbol: str = ""


#: By the unit of the quantity; the first that fits is proposed.
_SCALES = {
    "V": (
        Scale(1e-3, "millivolts", "mV"),
        Scale(1e-2, "hundredths of a volt", "cV"),
        Scale(0.1, "tenths of a volt", "0.1V"),
    ),
    "A": (
        Scale(1e-3, "milliamperes", "mA"),
        Scale(1e-2, "hundredths of an ampere", "cA"),
        Scale(0.1, "tenths of an ampere", "0.1A"),
        Scale(1e-6, "microamperes", "uA"),
    ),
    "degC": (
        Scale(0.1, "tenths of a degree", "0.1degC"),
        Scale(1e-2, "hundredths of a degree"),
        Scale(1e-3, "millidegrees"),
    ),
    "rad/s": (
        Scale(math.pi / 30.0, "rpm", "rpm"),
        Scale(math.pi / 180.0, "degrees per second", "deg/s"),
        Scale(1e-3, "milliradians per second"),
    ),
    "m/s": (Scale(1 / 3.6, "km/h", "km/h"), Scale(1852 / 3600, "knots", "kn")),
}

#: 0 K, and room temperature [degC], near which a temperature is likelier.
_KELVIN_DEGC, _ROOM_DEGC = -273.15, 25.0
#: Reported without a probe, by a DS18B20 and by thermistors.
_NO_PROBE_DEGC = (-127.0, -273.0, -273.15)
#: Effect of too low a sampling rate, and advice, by the owner of the quantity.
_TOO_SLOW = {
    "battery": "ohmic resistance and fast time constants blur into one; sample at 1 Hz or faster",
    "wheel": "a wheel slips for tenths of a second; sample the wheels at 20 Hz or faster",
}


def scales_of(quantity: Quantity, radius_m: float | None = None) -> tuple[Scale, ...]:
    """Units that are often forgotten; with the radius of the wheels [m] those of a speed at the rim, too."""
    known = _SCALES.get(quantity.unit, ())
    if quantity.owner != "wheel":
        return tuple(scale for scale in known if scale.name != "rpm")
    if radius_m is None:
        return known
    return (*known, Scale(1.0 / radius_m, "m/s", "m/s"), Scale(1e-3 / radius_m, "mm/s", "mm/s"))


def rescale(quantity: Quantity, scale: Scale, place: Place) -> str:
    """The fix for a wrong unit."""
    if place == "setup":
        return f"{scale.name}? then scale = {scale.factor:.4g}"
    return (
        f"{scale.name}? use --unit {quantity.channel}={scale.symbol}" if scale.symbol else f"{scale.name}? convert it"
    )


def beyond_limits(
    quantity: Quantity,
    lowest: float,
    highest: float,
    limits: ValueLimits,
    place: Place,
    what: str = "",
    often: str = "",
    radius_m: float | None = None,
) -> Iterator[Finding]:
    """A finding on values from lowest to highest that leave the limits of a quantity.

    what: the signal, before the sentence: "the voltage ".  often: a clause on how often.  radius_m: of the wheels [m].
    """
    low, high = limits
    if low <= lowest and highest <= high:
        return
    seen = _plain(lowest) if lowest == highest else f"{_plain(lowest)} to {_plain(highest)}"
    text = f"{what}reads {seen}{often}, plausible are {_plain(low)} to {_plain(high)}"
    yield Finding("error", text, _unit_advice(quantity, lowest, highest, limits, place, radius_m))


def _plain(value: float) -> str:
    """Four digits, without an exponent where people would write none."""
    return f"{value:.4g}" if abs(value) < 1e4 or abs(value) >= 1e7 else f"{float(f'{value:.4g}'):.0f}"


def _unit_advice(
    quantity: Quantity, lowest: float, highest: float, limits: ValueLimits, place: Place, radius_m: float | None
) -> str:
    low, high = limits
    if quantity.unit == "degC" and highest in _NO_PROBE_DEGC:
        return "its wire is off, or the probe dead"
    fits = [
        scale
        for scale in scales_of(quantity, radius_m)
        if low <= scale.factor * lowest and scale.factor * highest <= high
    ]
    if quantity.unit == "degC" and low <= lowest + _KELVIN_DEGC and highest + _KELVIN_DEGC <= high:
        middle = 0.5 * (lowest + highest)
        tenths = abs(0.1 * middle - _ROOM_DEGC) < abs(middle + _KELVIN_DEGC - _ROOM_DEGC)
        if place == "setup":
            return "tenths of a degree? then scale = 0.1" if tenths else f"kelvins? then offset = {_KELVIN_DEGC}"
        option = f"use --unit {quantity.channel}="
        return f"tenths of a degree, or kelvins? {option}0.1degC or K" if tenths else f"kelvins? {option}K"
    symbols = [scale.symbol for scale in fits if scale.symbol]
    if radius_m and place == "log" and len(symbols) > 1:  # units of wheels are alike in size
        return f"in another unit? use --unit {quantity.channel}={', '.join(symbols[:-1])} or {symbols[-1]}"
    if fits:
        return rescale(quantity, fits[0], place)
    if low >= 0.0 and low <= -highest and -lowest <= high:
        return "its wires are exchanged, or its sign is wrong"
    if place == "setup":
        return "check its unit, scale and offset, its wire, and that battery and robot file are those of this robot"
    return "check its column, its unit and the sensor"


def no_number(often: str, what: str = "", severity: Severity = "warning") -> Finding:
    """A finding on values that are not numbers; often: "in any of its values"."""
    return Finding(severity, f"{what}no number {often}", "look at the sensor and its wire; estimators skip them")


def no_numbers(count: int, samples: int, what: str = "") -> Iterator[Finding]:
    """A finding on the values of a signal that are not numbers, if count > 0."""
    if count == samples:
        yield no_number("in any of its values", what, "error")
    elif count:
        yield no_number(f"in {count} of {samples} values", what)


def too_seldom(quantity: Quantity, rate_hz: float, least_hz: float, what: str = "") -> Iterator[Finding]:
    """A finding on a signal that comes less often than least_hz; rate_hz is nan if unknown."""
    if rate_hz < least_hz:
        text = f"{what}comes {rate_hz:.2g} times a second; at least {least_hz:g} are needed"
        yield Finding("warning", text, _TOO_SLOW[quantity.owner])


def stuck(what: str = "", when: str = "", mover: str = "what moves with it") -> Finding:
    """A finding on a sensor that repeats its value while those it must follow change; when: " from 1 s to 2 s"."""
    text = f"{what}stuck: the same to the last bit{when} while {mover} moves"
    return Finding("error", text, "look at the sensor and its wire")


#: Fault of a source without any message.
NOTHING_CAME = "nothing came; is the other side on, connected and sending?"
#: Fault of counts without their number per turn.
NOT_COUNTED = "counts need counts_per_turn = ... in the setup"


def doubled(sources: Iterable[str], used: str = "") -> str:
    """The fault of a signal that several sources send; used: the one whose values are used."""
    choice = f"{used} is used, " if used else ""
    return f"{' and '.join(sources)} both send it; {choice}leave it out of one of them"


def missing(came: str) -> str:
    """The fault of a signal that its source should send but does not; came: "never came from can0"."""
    return f"{came}; check its wiring and its name there, or leave it out of signals"


def in_order(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Errors first, then warnings, then the rest."""
    return tuple(sorted(findings, key=lambda finding: get_args(Severity).index(finding.severity)))
