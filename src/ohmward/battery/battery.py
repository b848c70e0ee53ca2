"""Battery: its models, noise, and the provenance of its numbers."""

from __future__ import annotations

from dataclasses import dataclass, field

from ohmward.battery.knowledge import Knowledge
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.rc import RcModel
from ohmward.battery.models.sensor import CurrentSensor
from ohmward.battery.models.thevenin import Thevenin
from ohmward.checks import require_between, require_positive
from ohmward.errors import InputError


@dataclass(frozen=True)
class ConfidenceInterval:
    """A parameter with its 95 % confidence interval."""

    name: str  #: as in the battery file, with its unit
    #: in that unit
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class LogFit:
    """Quality of the model on one log."""

    log: str  #: its name
    test: str  #: kind of test
    #: the range that it covers
    soc_min: float
    soc_max: float
    #: measured minus simulated voltage; 0 for a log that only gave the OCV curve
    residual_rms_V: float = 0.0
    residual_max_V: float = 0.0


@dataclass(frozen=True)
class Provenance:
    """Provenance of the numbers of a battery."""

    capacity_given_Ah: float  #: of the user
    capacity_measured_Ah: float = 0.0  #: from the logs, 0 where they do not tell it
    logs: tuple[LogFit, ...] = ()  #: one entry for each log
    confidence: tuple[ConfidenceInterval, ...] = ()  #: 95 % intervals of the parameters
    notes: tuple[str, ...] = ()  #: assumptions and findings, warnings included
    #: of the logs, see `battery.fingerprint`; none of them teaches the battery once more
    fingerprints: tuple[str, ...] = ()


@dataclass(frozen=True)
class Battery:
    """Battery, a cell or a pack. All voltages and resistances are those of the whole pack.

    Attributes:
        name: for people.
        capacity_Ah: charge between full and empty, > 0.
        chemistry: such as "lfp", "" where unknown.
        n_series: cells in series.
        voltage_min_V, voltage_max_V: range seen in the logs.
        idle_current_A: current at rest (<= 0; 0 in a laboratory), where the user has declared it: then every rest
            shows the offset of the current sensor. None where unknown.
        thevenin, rc: the models that were identified; at least one.
        noise, rc_noise: to be assumed by an estimator with the Thevenin and with the RC model.
        sensor: current sensor of the robot.
        serial_number: of this very battery, "" where unknown.
        identification: provenance of the numbers, None for those of a data sheet.
        not_identified: parameters that could not be identified, and why.
        knowledge: what logs have taught, None for a battery that has not learnt.
    """

    name: str
    capacity_Ah: float
    chemistry: str = ""
    n_series: int = 1
    voltage_min_V: float = 0.0
    voltage_max_V: float = 1000.0
    idle_current_A: float | None = None
    thevenin: Thevenin | None = None
    rc: RcModel | None = None
    noise: BatteryNoise = field(default_factory=BatteryNoise)
    rc_noise: BatteryNoise = field(default_factory=BatteryNoise)
    sensor: CurrentSensor = field(default_factory=CurrentSensor)
    identification: Provenance | None = None
    not_identified: tuple[str, ...] = ()
    serial_number: str = ""
    knowledge: Knowledge | None = None

    def __post_init__(self) -> None:
        require_positive("capacity_Ah", self.capacity_Ah)
        require_between("n_series", self.n_series, 1, float("inf"))
        if self.idle_current_A is not None:
            require_between("idle_current_A", self.idle_current_A, -self.capacity_Ah, 0.0)
        if not self.voltage_min_V < self.voltage_max_V:
            raise InputError(
                f"voltage_min_V must be below voltage_max_V, got {self.voltage_min_V:g} and {self.voltage_max_V:g}"
            )
        if self.thevenin is None and self.rc is None:
            raise InputError(f"battery {self.name!r} has no model: give thevenin or rc")
        for name, model in (("thevenin", self.thevenin), ("rc", self.rc)):
            if model is not None and model.capacity_Ah != self.capacity_Ah:
                raise InputError(
                    f"battery {self.name!r} has {self.capacity_Ah:g} Ah and its model {name} {model.capacity_Ah:g}; "
                    "give both the same"
                )


def require_thevenin(battery: Battery) -> Thevenin:
    """The Thevenin model of a battery, or InputError where it has none."""
    if battery.thevenin is None:
        raise InputError(
            f"{battery.name}: the battery file has no [thevenin] model, which is needed here; choose the filter `rc`, "
            "or make one with `ohmward identify ... --model thevenin` or `ohmward generic`"
        )
    return battery.thevenin


def require_rc(battery: Battery) -> RcModel:
    """The RC model of a battery file, or InputError where it has none."""
    if battery.rc is None:
        raise InputError(
            f"{battery.name}: the battery file has no [rc] model, which this filter needs; "
            "identify one with `ohmward identify ... --model rc`"
        )
    return battery.rc


def require_battery(battery: object, others: str = "") -> Battery:
    """The battery itself, or InputError for anything else, as the path of one.

    others: what else would do, in words.
    """
    if not isinstance(battery, Battery):
        raise InputError(
            f"battery must be a Battery{others}, got {type(battery).__name__}; load_battery(path) reads one, "
            "identify(logs, capacity_Ah=...) makes one"
        )
    return battery
