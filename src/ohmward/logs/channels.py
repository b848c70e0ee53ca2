"""The channels of batteries and drives: names that log columns have for the quantities of the table."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

from ohmward.logs.units import LABELS, UNITS, Unit, unit_of
from ohmward.quantities import QUANTITIES, Quantity, each_with_each, unaccented, words_of

SIDES = frozenset(("left", "right"))
CORNERS = SIDES | {"front", "rear"}

# Abbreviations in the names of wheels and of the body's sensors, spelled out.
_SPELLED_OUT: dict[str, tuple[str, ...]] = {
    "l": ("left",), "r": ("right",), "back": ("rear",),
    **dict.fromkeys(("links", "linkes", "gauche", "izquierda", "izquierdo", "izq", "sinistra", "sx"), ("left",)),
    **dict.fromkeys(("rechts", "rechtes", "droite", "derecha", "derecho", "der", "destra", "dx"), ("right",)),
    **dict.fromkeys(("vorn", "vorne", "avant"), ("front",)), **dict.fromkeys(("hinten", "arriere"), ("rear",)),
    **dict.fromkeys(("fl", "lf"), ("front", "left")), **dict.fromkeys(("fr", "rf"), ("front", "right")),
    **dict.fromkeys(("rl", "bl", "lr", "lb"), ("rear", "left")),
    **dict.fromkeys(("rr", "br", "rb"), ("rear", "right")),
    "lwheel": ("wheel", "left"), "rwheel": ("wheel", "right"),
    "wl": ("w", "left"), "wr": ("w", "right"), "vl": ("v", "left"), "vr": ("v", "right"),
    "il": ("i", "left"), "ir": ("i", "right"),
    "wz": ("w", "z"), "gz": ("gyro", "z"), "ax": ("a", "x"), "yawrate": ("yaw", "rate"),
}  # fmt: skip


#: Words for wheels in other scripts, the longest first.
_OTHER_SCRIPTS = {
    unaccented(sign): word
    for word, signs in (
        ("omega", "角速度"), ("speed", "回転速度 回転数 转速 轉速 速度 скорость обороты"),
        ("motor", "モーター 电机 電機 马达 мотора мотор"), ("current", "电流 電流 ток"),
        ("wheel", "車輪 车轮 轮 輪 колеса колесо"), ("left", "左 левого левое левый левая"),
        ("right", "右 правого правое правый правая"), ("front", "前 переднее передний"),
        ("rear", "后 後 заднее задний"),
    )
    for sign in signs.split()
}  # fmt: skip


#: Boundary between words: in `PackVoltage`, not in `mAmps`; after the letter in `Iavg`.
_WITHIN = re.compile(r"(?<=[a-z][a-z])(?=[A-Z][a-z])|(?<=\b[IUViuv])(?=avg\b)")


#: Quantities that some languages write as one word with what they belong to: `Batteriestrom`, `电池电压`.
_LAST_PARTS = (
    "strom spannung temperatur zeit leistung stroom spanning vermogen tijd strøm spænding feszültség 电压 电流 温度 "
    "时间 功率 電圧 電流 電力 時間 電壓 溫度 전압 전류 온도 시간 전력"
)
_COMPOUND = re.compile(rf"(?<=[^\W\d_])(?=(?:{unaccented(_LAST_PARTS).replace(' ', '|')})(?![^\W\d_]))")


def letters(stem: str) -> list[str]:
    """Words of letters in lower case, without accents: `T1_Batt` as t, batt; `PackVoltage` as pack, voltage.

    Compounds are divided, `Akkustrom` as akku, strom; labels in braces are left out.
    """
    text = unaccented(_WITHIN.sub(" ", LABELS.sub("", stem)).lower())
    return re.findall(r"[^\W\d_]+", _COMPOUND.sub(" ", text))


def robot_words(stem: str) -> list[str]:
    """Words and numbers, abbreviations spelled out: `velL` as vel, left; `m1vel` as m, 1, vel."""
    text = unaccented(stem)
    for sign, word in _OTHER_SCRIPTS.items() if not text.isascii() else ():
        text = re.sub(sign, f" {word} ", text, flags=re.IGNORECASE)
    parts = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", text)
    return [word for part in parts for word in _SPELLED_OUT.get(part.lower(), (part.lower(),))]


class Channel(NamedTuple):
    """A quantity that a column may hold."""

    name: str  #: as in `columns={"current": "I_batt"}`; for a wheel it follows the wheel's name
    #: of its units; default: the unit where a column names none; example: units for a message
    dimensions: tuple[str, ...]

    default: Unit
    example: str
    words: frozenset[frozenset[str]]  #: each a set of words that names it, in any order
    beside: tuple[frozenset[str], ...]  #: words that may stand beside those, the best fit first
    split: Callable[[str], list[str]] = robot_words  #: the words in a column's name
    required: bool = False  #: without it a recording is refused
    first_of_many: bool = False  #: of several columns that fit equally well the first is taken, not refused


def word_set(text: str) -> frozenset[str]:
    """The words of a text, without accents."""
    return frozenset(unaccented(text).split())


#: Words of what goes into a battery or a converter, and out of it.
IN, OUT = word_set("in input eingang"), word_set("out output ausgang")

# Words that say where the whole battery was measured; they do not make it another quantity.
_OF_BATTERY = word_set(
    "battery batt bat bms hv pack terminal total measured meas test state field data main header stamp surface payload "
    "utc gmt inst instantaneous dc sys sum de di do da la du del della batterie bateria batteria akku baterii accu "
    "batteri akun batarya we tot klemmen gesamt mess prüf lauf uhr monitor акб аккумулятора 电池 电池组 "
    "电池组总 总 充放电 测试 采集 记录 累计 绝对 経過 测量 電池 バッテリー 総 측정 배터리"
)
# Words of columns that are used only if there is nothing better.
_SECOND_CHOICE = word_set("cell raw mean avg ave average filtered last")
# And of columns that are used only if there is none of those either.
_THIRD_CHOICE = word_set("now latest bus in input line received recorded enqueued published sent reading value source")
_BESIDE_BATTERY = (
    frozenset[str](),
    _OF_BATTERY,
    _OF_BATTERY | _SECOND_CHOICE,
    _OF_BATTERY | _SECOND_CHOICE | _THIRD_CHOICE,
)
_BESIDE_WHEELS = (
    word_set(
        "wheel wheels whl drivewhl hub base to rueda roue ruota motor mot mc esc m joint joints state states drive "
        "angular ang rim encoder enc measured meas actual act feedback fb service delta increment axis estimate field"
    ),
)
_BESIDE_BODY = (word_set("imu data body base robot msg"),)


def channel_for(quantity: Quantity) -> Channel:
    """The channel of a quantity: how to recognise its columns by their words."""
    unit = unit_of(quantity.unit)
    assert unit is not None, f"{quantity.name}: no unit {quantity.unit!r}"
    of_battery = quantity.owner == "battery"
    return Channel(
        quantity.channel,
        (unit.dimension, *quantity.other_dimensions),
        unit,
        quantity.example,
        quantity.words,
        _BESIDE_BATTERY if of_battery else _BESIDE_BODY if quantity.owner == "body" else _BESIDE_WHEELS,
        letters if of_battery else robot_words,
        required=quantity.required,
        first_of_many=of_battery and not quantity.required,
    )


_OF_TABLE = {quantity.name: channel_for(quantity) for quantity in QUANTITIES.values() if quantity.words}


def _channels_of(owner: str) -> tuple[Channel, ...]:
    return tuple(channel for name, channel in _OF_TABLE.items() if QUANTITIES[name].owner == owner)


TIME = Channel(
    "time", ("time",), UNITS["s"], "s, ms, min or h",
    words_of("time", "t", "timestamp", "when", "time stamp", "datetime", "date time", "date", "stamp", "elapsed",
             "elapsed time", "unix", "unix time", "unix ts", "unixtime", "relative time", "total time", "header stamp",
             "seconds", "sec", "epoch", "ts", "realtime", "run time", "prog time", "program time", "date and time",
             "last changed", "last updated", "test", "x value", "cumulative time", "absolute time", "record time",
             "system time", "uptime", "time of day", "time boot", "rosbag timestamp", "zeit", "zeitstempel", "datum",
             "temps", "horodatage", "tiempo", "tempo", "czas", "время", "时间", "時間", "시간", "zeitpunkt", "heure",
             "date heure", "fecha", "hora", "fecha hora", "fecha y hora", "data hora", "data e hora", "ora", "godzina",
             "tijd", "tid", "aika", "idő", "čas", "zaman", "tarih", "χρόνος", "clock", "update time",
             "custom update time", "created at", "at", "時刻", "日時", "dpt time", "tst", "device time", "日期",
             *each_with_each("gesamt test prüf mess lauf", "zeit"), *each_with_each("总 测试 累计 绝对 经过", "时间")),
    _BESIDE_BATTERY, letters, required=True,
)  # fmt: skip
CURRENT = _OF_TABLE["battery_current_A"]
VOLTAGE = _OF_TABLE["battery_voltage_V"]
TEMPERATURE = _OF_TABLE["battery_temperature_degC"]
WHEEL_SPEED = _OF_TABLE["wheel_speed_rad_s"]
#: Counts become a speed.
WHEEL_COUNTS = _OF_TABLE["wheel_counts"]._replace(name=WHEEL_SPEED.name, example=WHEEL_SPEED.example)
MOTOR_CURRENT = _OF_TABLE["motor_current_A"]

_OF_A_TABLE = (word_set("values value table curve mean average avg quasi cell pack battery cc reference ref"),)
_OPEN_CIRCUIT = "- voltage v u e emf ocv ocp uocv vocv"
#: The columns of a table of open-circuit voltage; of several that fit equally well the first is taken.
OCV_TABLE = tuple(
    Channel(name, (unit.dimension,), unit, example, words, _OF_A_TABLE, letters, first_of_many=True)
    for name, unit, example, words in (
        ("soc", UNITS["1"], "% or 1", words_of("soc", "state of charge", "charge state", "z")),
        ("ocv", UNITS["v"], "V or mV",
         words_of("ocv", "ocp", "emf", "voltage", "potential", "v", "u", "e", "uocv", "vocv", "voc", "uoc",
                  "ocv voltage", *each_with_each("v u", "oc ocv"), "open circuit", "open circuit voltage",
                  "open circuit potential", "equilibrium voltage")),
        ("ocv_charge", UNITS["v"], "V or mV", words_of(*each_with_each(_OPEN_CIRCUIT, "charge charging chg ch"))),
        ("ocv_discharge", UNITS["v"], "V or mV",
         words_of(*each_with_each(_OPEN_CIRCUIT, "discharge discharging dischg dchg dis"))),
        ("hysteresis", UNITS["v"], "V or mV",
         words_of("hysteresis", "hysteresis voltage", "half gap", "hysteresis half gap")),
        ("ocv_slope", UNITS["v/k"], "V/K or mV/K",
         words_of("dvdt", "dudt", "docvdt", *each_with_each("dv du de docv dvoltage", "dt dtemperature"),
                  *each_with_each("entropy entropic temperature", "coefficient"))),
        ("reference_temperature", UNITS["degc"], "degC, K or degF", TEMPERATURE.words - words_of("t")),
    )
)  # fmt: skip

#: The channels of a battery's log.
BATTERY = (TIME, *_channels_of("battery"))
#: The channels of each wheel, those of the motor only where it is driven.
WHEEL = (WHEEL_SPEED, MOTOR_CURRENT)
#: A yaw angle is turned into a rate if there is no gyro.
YAW = Channel("yaw", ("angle",), UNITS["rad"], "rad or deg", words_of("yaw", "yaw angle"), _BESIDE_BODY)
#: The channels of a robot's body.
BODY = (*_channels_of("body"), YAW)
CHANNELS = {channel.name: channel for channel in (*BATTERY, *WHEEL, *BODY, *OCV_TABLE)}


def channel_of(quantity: str) -> Channel:
    """The channel of a quantity, also of a single wheel: `front_left_wheel_speed` is a `wheel_speed`."""
    of_wheels = [channel for channel in WHEEL if quantity.endswith(channel.name)]
    return of_wheels[0] if of_wheels else CHANNELS[quantity]
