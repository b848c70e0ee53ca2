"""Quantities that the sensors of a robot measure: one table, and the limits of their values.

A quantity, its signal on the robot, its path over MQTT and its column in the store have the same name. A plain name
belongs to the body or the battery, `battery_current_A`; for each wheel, motor or cell, a dot and the wheel's name or a
number from 0 follow: `wheel_speed_rad_s.front_left`, `motor_current_A.0`, `cell_voltage_V.3`.

A row of the table is all that a quantity needs to be read from logs, wired, checked, stored and shown. Estimating from
it takes code of its own; until there is some, the row says `estimated_from=False`.
"""

from __future__ import annotations

import difflib
import math
import unicodedata
from functools import cache
from typing import Any, NamedTuple

from ohmward.errors import InputError

#: An hour and a day [s].
SECONDS_PER_HOUR = 3600.0
DAY_S = 24 * SECONDS_PER_HOUR

#: Seconds since 1970 before which a date, here the year 2000, is that of a clock that nobody has set.
FIRST_DATE_S = 946_684_800.0


class ValueLimits(NamedTuple):
    """Lowest and highest value of a quantity."""

    lowest: float
    highest: float


class Quantity(NamedTuple):
    """A quantity that sensors measure."""

    name: str  #: with its unit; signs as in docs/conventions.md
    meaning: str  #: in a few words
    owner: str  #: "battery" or "body"; "cell", "wheel", "motor" or "estimate" where there are several
    unit: str = ""  #: symbol of `ohmward.logs.units`, which knows its dimension
    #: range of a working sensor; nan and infinity count as not measured
    limits: ValueLimits = ValueLimits(-math.inf, math.inf)
    words: frozenset[frozenset[str]] = frozenset()  #: names of its columns, each a set of words in any order
    example: str = ""  #: units for a message
    other_dimensions: tuple[str, ...] = ()  #: of a column's unit, besides that of `unit`
    #: an estimator uses it, so that a log has a field for it; else it is only read, stored and shown
    estimated_from: bool = True
    required: bool = False  #: a log of its owner is rejected without it
    #: rate below which an estimator is of little use: for a battery from logs at 1 Hz, for a wheel from the time in
    #: which it begins to slip
    least_hz: float = 0.0
    ros_type: str = ""  #: ROS message that contains it, `sensor_msgs/msg/BatteryState`
    ros_field: str = ""  #: path of its field in that message
    axis_label: str = ""  #: in its figures, where it is not the name with the unit
    #: names of its signals, for a quantity that is not a column of a log: a log's `soc` may come from any source
    signal_words: frozenset[frozenset[str]] = frozenset()

    @property
    def each(self) -> str:
        """Owner of which there are several: "cell", "wheel", "motor" or "estimate"; "" where there is one."""
        return "" if self.owner in ("battery", "body") else self.owner

    @property
    def group(self) -> str:
        """Group whose log and row of the store contain it: "battery" or "drive"; "" for neither."""
        return next((group for group, owners in GROUPS.items() if self.owner in owners), "")

    @property
    def field(self) -> str:
        """Name in a battery log or a drive log: `current_A`."""
        return self.name.removeprefix("battery_")

    @property
    def channel(self) -> str:
        """Name without its unit, as in `columns={"current": "I_batt"}`."""
        return self.field.removesuffix("_" + self.unit.replace("/", "_"))

    @property
    def label(self) -> str:
        """Display name: `Current`."""
        return self.channel.replace("_", " ").capitalize()

    @property
    def axis(self) -> str:
        """Label of its axis in figures: `Voltage [V]`."""
        return self.axis_label or f"{self.label} [{self.unit}]"


def unaccented(text: str) -> str:
    """The text without accents, as many loggers write it: `tensão` as `tensao`."""
    if text.isascii():
        return text
    return "".join(char for char in unicodedata.normalize("NFKD", text) if not unicodedata.combining(char))


def words_of(*names: str) -> frozenset[frozenset[str]]:
    """Names of a quantity as sets of words, without accents."""
    return frozenset(frozenset(unaccented(name).split()) for name in names)


def each_with_each(first: str, second: str) -> list[str]:
    """Every word of the first with every word of the second; `-` stands for no word."""
    return [f"{a} {b}".replace("-", "") for a in first.split() for b in second.split()]


def current_limits(ways: str) -> list[str]:
    """Names of a current limit, with each of the words for its direction."""
    return each_with_each(ways, "limit") + [
        f"{way} {most} {current}" for way in ways.split() for most in ("max", "limit") for current in ("current", "i")
    ]


_BMS, _CHARGE, _DISCHARGE = "bms battery batt pack", "charge charging chg", "discharge discharging dischg dsg"
_COMPASSES = "- compass magnetic mag gnss gps"
_SPEEDOMETERS = "- ground gnss gps rtk vtg vo visual flow radar lidar"
_BATTERY_STATE, _IMU, _ODOMETRY = "sensor_msgs/msg/BatteryState", "sensor_msgs/msg/Imu", "nav_msgs/msg/Odometry"

#: Of what says how far another value can be trusted: an estimator refuses that one where this is too large.
_NOT_NEGATIVE = ValueLimits(0.0, math.inf)

_TABLE = (
    Quantity(
        "battery_current_A", "current of the battery, > 0 charges", "battery", "A", ValueLimits(-5000.0, 5000.0),
        words_of("current", "i", "cur", "curr", "ipack", "amp", "amps", "ampere", "amperes", "amperage",
                 "shunt current",
                 "ibat", "ibus", "ibatt", "im", "iinst", "itot", "imess", "strom", "courant", "intensité", "corriente",
                 "intensidad", "corrente", "intensità", "intensidade", "prąd", "proud", "stroom", "strøm", "virta",
                 "áram", "akım", "ρεύμα", "ток", "电流", "電流", "전류"),
        "A or mA", required=True, least_hz=0.5, ros_type=_BATTERY_STATE, ros_field="current",
        axis_label="Current [A], > 0 charges",
    ),
    Quantity(
        "battery_voltage_V", "voltage at the terminals of the pack", "battery", "V", ValueLimits(0.0, 2000.0),
        words_of("voltage", "v", "u", "vol", "volt", "volts", "potential", "vtot", "vpack", "upack", "vfas", "vf",
                 "vbat", "vbus", "vbatt", "ubat", "ubatt", "ecell", "ewe", "vterm", "umess", "spannung", "tension",
                 "tensión", "voltaje", "tensione", "tensão", "spänning", "spænding", "jännite", "feszültség", "gerilim",
                 "napětí", "napięcie", "τάση", "напряжение", "电压", "总压", "電圧", "電壓", "전압"),
        "V or mV", required=True, least_hz=0.5, ros_type=_BATTERY_STATE, ros_field="voltage",
    ),
    Quantity(
        "battery_temperature_degC", "temperature of the battery", "battery", "degC",
        ValueLimits(-60.0, 120.0),  # sensors say -127 or -273 when their wire is off
        words_of("temperature", "temp", "t", "tbat", "tbatt", "temperature t", "temperature a", "aux temperature",
                 "temperatur", "température", "temperatura", "temperatuur", "teplota", "lämpötila", "hőmérséklet",
                 "sıcaklık", "θερμοκρασία", "температура", "温度", "溫度", "온도"),
        "degC, K or degF", ros_type=_BATTERY_STATE, ros_field="temperature", axis_label="Temperature [°C]",
    ),
    Quantity("battery_full", "1 while the charger says that the battery is full, else 0", "battery", "1",
             ValueLimits(0.0, 1.0)),
    Quantity("battery_changed", "1 when another battery was put in: the charge before does not count", "battery", "1",
             ValueLimits(0.0, 1.0), estimated_from=False),
    Quantity("bms_soc", "state of charge by the battery's own management, beside ours", "battery", "1",
             ValueLimits(0.0, 1.0), example="% or 1", estimated_from=False, ros_type=_BATTERY_STATE,
             ros_field="percentage", signal_words=words_of("soc", "bms soc", "state of charge", "percentage")),
    Quantity("bms_charge_limit_A", "largest current of charge that the battery's management allows", "battery", "A",
             ValueLimits(0.0, 5000.0), example="A or mA", estimated_from=False,
             signal_words=words_of("ccl", *current_limits(_CHARGE))),
    Quantity("bms_discharge_limit_A", "largest current of discharge that it allows", "battery", "A",
             ValueLimits(0.0, 5000.0), example="A or mA", estimated_from=False,
             signal_words=words_of("dcl", *current_limits(_DISCHARGE))),
    Quantity("bms_alarm", "alarms of the battery's management, 0 for none", "battery", "1",
             ValueLimits(0.0, 2.0**64), estimated_from=False,
             signal_words=words_of(*each_with_each(_BMS, "alarm alarms fault faults error errors"))),
    Quantity("cell_voltage_V", "voltage of each cell", "cell", "V", ValueLimits(0.0, 20.0)),
    Quantity(
        "wheel_speed_rad_s", "speed of each wheel behind its gear, > 0 drives forward", "wheel", "rad/s",
        ValueLimits(-1e4, 1e4),
        words_of("speed", "spd", "rpm", "vel", "velocity", "velocities", "v", "w", "omega", "rate", "angvel",
                 "drehzahl", "raddrehzahl", "geschwindigkeit", "radgeschwindigkeit", "vitesse", "velocidad"),
        "rad/s, rpm, m/s, counts, rad or m", ("speed", "turn rate", "turn", "angle", "length"), least_hz=5.0,
    ),
    Quantity(
        "wheel_counts", "count of each wheel's encoder, which may overflow", "wheel", "counts",
        words=words_of("counts", "count", "ticks", "tick", "encoder", "enc", "position", "positions", "pos", "angle",
                       "s", "way", "distance", "dist", "travel", "odo", "odom", "odometer", "weg", "strecke",
                       "distancia"),
        other_dimensions=("angle", "length"), least_hz=5.0,
    ),
    Quantity(
        "motor_current_A", "current of each motor, > 0 drives forward", "motor", "A", ValueLimits(-2000.0, 2000.0),
        words_of("current", "currents", "cur", "curr", "i", "iq", "amps"), "A or mA",
    ),
    Quantity(
        "yaw_rate_rad_s", "yaw rate from a gyro, > 0 to the left", "body", "rad/s",
        ValueLimits(-35.0, 35.0),  # 2000 degrees per second
        words_of(*each_with_each("yaw", "rate vel velocity speed gyro"), *each_with_each("gyro gyr w omega", "z"),
                 "angular velocity z", "ang vel z", "gyro 2", "gyro rad 2", "gierrate"),
        "rad/s or deg/s", ros_type=_IMU, ros_field="angular_velocity.z",
    ),
    Quantity(
        "steering_rad", "angle of the steered wheel, or of the middle of two, > 0 to the left", "body", "rad",
        ValueLimits(-math.pi, math.pi),
        words_of("steering", "steer", *each_with_each("steering steer", "angle position pos"), "lenkwinkel"),
        "rad or deg",
    ),
    Quantity(
        "acceleration_m_s2", "acceleration along x, gravity included", "body", "m/s2", ValueLimits(-200.0, 200.0),
        words_of(*each_with_each("acceleration accel acc", "- x forward long longitudinal"), "a x",
                 *(f"linear {name}" for name in each_with_each("acceleration accel acc", "x forward"))),
        "m/s2 or g", ros_type=_IMU, ros_field="linear_acceleration.x",
    ),
    Quantity("pitch_rad", "pitch from an attitude filter, > 0 with the nose up", "body", "rad", ValueLimits(-1.5, 1.5),
             words_of("pitch", "pitch angle"), "rad or deg"),
    Quantity(
        "speed_m_s", "speed of the body from GNSS, visual or lidar odometry", "body", "m/s", ValueLimits(-50.0, 50.0),
        words_of(*each_with_each("speed velocity sog groundspeed geschwindigkeit vitesse velocidad", _SPEEDOMETERS),
                 *(f"speed {name}" for name in each_with_each("ground", "over gnss gps rtk"))),
        "m/s or km/h", ros_type=_ODOMETRY, ros_field="twist.twist.linear.x",
    ),
    Quantity("speed_std_m_s", "standard deviation of that speed", "body", "m/s", _NOT_NEGATIVE,
             words_of(*(f"speed {name}" for name in each_with_each("std sigma", _SPEEDOMETERS))), "m/s"),
    Quantity("speed_age_s", "age of that speed", "body", "s", _NOT_NEGATIVE,
             words_of(*(f"age {name}" for name in each_with_each("speed", _SPEEDOMETERS))), "s or ms"),
    Quantity("heading_rad", "heading from a compass or GNSS antennas, > 0 to the left, from any zero", "body", "rad",
             ValueLimits(-1e4, 1e4), words_of("compass", *each_with_each(_COMPASSES, "heading")), "rad or deg"),
    Quantity("heading_std_rad", "standard deviation of that heading", "body", "rad", _NOT_NEGATIVE,
             words_of(*each_with_each("heading", "std sigma")), "rad or deg"),
    Quantity("home_distance_m", "length of the way home, for the probability of reaching it", "body", "m",
             ValueLimits(0.0, 1e6), estimated_from=False, signal_words=words_of("home distance", "distance home")),
    Quantity("pose_reset", "1 when the pose is to restart at its origin", "body", "1", ValueLimits(0.0, 1.0),
             estimated_from=False),
    #: From a microcontroller with its own estimator: passed on with the states, and not used.
    Quantity("estimate", "estimate of a microcontroller, by its own name", "estimate", estimated_from=False),
)  # fmt: skip

QUANTITIES = {quantity.name: quantity for quantity in _TABLE}

#: Quantities that are sent only when something happens: their absence is no fault.
EVENTS = ("battery_full", "battery_changed", "pose_reset")

#: Owners whose quantities share a log and a row of the store.
GROUPS = {"battery": ("battery", "cell"), "drive": ("wheel", "motor", "body")}


@cache
def names_of(group: str) -> tuple[str, ...]:
    """Names of the quantities of the "battery", with its cells, or of the "drive"."""
    return tuple(quantity.name for quantity in QUANTITIES.values() if quantity.group == group)


#: Quantities of the body that estimators take: arguments of `SlipEstimator.update` or `Odometry.update`.
BODY = tuple(name for name, quantity in QUANTITIES.items() if quantity.owner == "body" and quantity.estimated_from)


def quantity_of(signal: str) -> Quantity:
    """Quantity of a signal, from the part of its name before the dot.

    Raises:
        InputError: no quantity of that name, or a wheel, motor or cell named where there is only one value, or the
            other way round.
    """
    name, dot, part = signal.partition(".")
    if name not in QUANTITIES:
        near = difflib.get_close_matches(name, QUANTITIES, n=1, cutoff=0.5)
        advice = (
            f"did you mean {near[0]}? Units are part of the names" if near else f"there are: {', '.join(QUANTITIES)}"
        )
        raise InputError(f"{signal!r} is not a quantity; {advice}")
    quantity = QUANTITIES[name]
    if bool(quantity.each) != bool(dot and part):
        fix = f"write {name}.NAME, the name of the {quantity.each} or its number from 0" if quantity.each else "no dot"
        raise InputError(f"{signal!r}: there is {'one for each ' + quantity.each if quantity.each else 'one'}; {fix}")
    return quantity


#: Largest current of a battery, charge or discharge, in capacities per hour: model aircraft reach it.
MOST_C = 20.0

#: Voltages beyond the battery file's limits by these factors belong to another battery or are in another unit: no
#: battery is used at 70 % of its lowest voltage or charged to 110 % of its highest.
_LOWEST_SHARE, _HIGHEST_SHARE = 0.7, 1.1

#: Fastest rim of a robot with a known wheel [m/s]: a fast runner.
_FASTEST_RIM_M_S = 10.0


def limits_of(name: str, battery: Any = None, robot: Any = None) -> ValueLimits:
    """Limits of a quantity: those of this robot where its battery file or robot file has them, else of every sensor.

    battery: a `Battery`, or None.  robot: a `Robot`, or None.
    """
    if battery and name in ("battery_voltage_V", "cell_voltage_V"):
        share = 1.0 if name == "battery_voltage_V" else 1.0 / battery.n_series
        return ValueLimits(
            _LOWEST_SHARE * share * battery.voltage_min_V, _HIGHEST_SHARE * share * battery.voltage_max_V
        )
    if battery and name == "battery_current_A":
        return ValueLimits(-MOST_C * battery.capacity_Ah, MOST_C * battery.capacity_Ah)
    if robot and name == "wheel_speed_rad_s":
        return ValueLimits(-_FASTEST_RIM_M_S / robot.wheel.radius_m, _FASTEST_RIM_M_S / robot.wheel.radius_m)
    return QUANTITIES[name].limits


#: Temperature range in which batteries are used.
COLDEST_DEGC, HOTTEST_DEGC = limits_of("battery_temperature_degC")

#: Speed that no wheeled robot exceeds.
FASTEST_M_S = limits_of("speed_m_s").highest

#: Largest wheel speed and motor current that a filter accepts, whatever the size of the robot: sensors on a bench may
#: show more, the wheels and motors of a robot do not.
MOST_WHEEL_RAD_S, MOST_MOTOR_A = 500.0, 200.0
