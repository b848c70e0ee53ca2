"""Battery: its models, noise, the provenance of its numbers, and what it has learnt from logs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ohmward.battery.models.noise import BatteryNoise, CurrentSensor
from ohmward.battery.models.ocv import slip_shape
from ohmward.battery.models.thevenin import Thevenin
from ohmward.checks import require_between, require_finite, require_positive
from ohmward.errors import InputError
from ohmward.rich_display import RichDisplay


@dataclass(frozen=True)
class SeenLog:
    """A log that a battery has learnt from."""

    name: str  #: of the log
    fingerprint: str = ""  #: of its measurements, the same for another copy of the log; "" where none was computed
    #: Unix time of its first and its last sample, None without a wall clock
    start_unix_s: float | None = None
    end_unix_s: float | None = None
    hours: float = 0.0  #: its length
    summary: str = ""  #: what was learnt from it, in a line
    anchors: int = 0  #: number of times at which something other than the voltage gave its state of charge
    #: state of charge at its last sample, None where that was not learnt from, or in a file that did not keep it
    end_soc: float | None = None
    end_soc_std: float | None = None  #: its standard deviation
    end_current_A: float = 0.0  #: current there


@dataclass(frozen=True)
class Knowledge:
    """Covariance of the errors left in the parameters of a battery file; their means are in the file itself."""

    names: tuple[str, ...]  #: (K,) names of the parameters, as `learning.parameters` defines them
    covariance: tuple[float, ...]  #: (K (K + 1) / 2,) lower triangle, row by row
    logs: tuple[SeenLog, ...] = ()  #: logs that the battery has learnt from, in order
    #: lowest state of charge in these logs. Above it the curve is known over the charge below full, whatever the
    #: capacity; below it, over SoC.
    seen_from_soc: float = 1.0

    def __post_init__(self) -> None:
        size = len(self.names)
        if len(self.covariance) != size * (size + 1) // 2:
            raise InputError(
                f"knowledge.covariance must be the lower triangle of {size} by {size} parameters, "
                f"{size * (size + 1) // 2} numbers, got {len(self.covariance)}; remove [knowledge] to start again"
            )
        require_finite("knowledge.covariance", self.covariance)
        require_between("knowledge.seen_from_soc", self.seen_from_soc, 0.0, 1.0)

    @classmethod
    def of(
        cls, names: Sequence[str], covariance: np.ndarray, logs: Sequence[SeenLog] = (), seen_from_soc: float = 1.0
    ) -> Knowledge:
        """The knowledge with this covariance (K, K)."""
        lower = covariance[np.tril_indices(len(names))]
        return cls(tuple(names), tuple(lower.tolist()), tuple(logs), seen_from_soc)

    @cached_property
    def matrix(self) -> np.ndarray:
        """(K, K) covariance; eigenvalues that rounding in the file made too small are raised to a minimum."""
        size = len(self.names)
        full = np.zeros((size, size))
        full[np.tril_indices(size)] = self.covariance
        full += np.tril(full, -1).T
        std = np.sqrt(np.maximum(np.diag(full), _LEAST_VARIANCE))
        values, vectors = np.linalg.eigh(full / np.outer(std, std))
        matrix = np.outer(std, std) * ((vectors * np.maximum(values, _LEAST_KNOWN_EIGENVALUE)) @ vectors.T)
        matrix.flags.writeable = False  # made once for all that ask
        return matrix


#: Smallest eigenvalue of a correlation matrix: numbers in a file have six digits.
_LEAST_KNOWN_EIGENVALUE = 1e-6
#: Smallest variance of a parameter, in its unit.
_LEAST_VARIANCE = math.ulp(1.0)


#: Loss of capacity until the file learns again, and error of the slip that stands for a curve pinned at full.
_LOST_SINCE, _PINNED_STD = 0.05, 0.2
_SOC = np.linspace(0.0, 1.0, 101)


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
    #: range of SoC in the log
    soc_min: float
    soc_max: float
    #: measured minus simulated voltage; 0 for a log that only gave the OCV curve
    residual_rms_V: float = 0.0
    residual_max_V: float = 0.0


@dataclass(frozen=True)
class Provenance:
    """Provenance of the numbers of a battery."""

    capacity_given_Ah: float  #: by the user
    capacity_measured_Ah: float = 0.0  #: from the logs, 0 where they do not show it
    logs: tuple[LogFit, ...] = ()  #: one entry for each log
    confidence: tuple[ConfidenceInterval, ...] = ()  #: 95 % intervals of the parameters
    notes: tuple[str, ...] = ()  #: assumptions and findings, warnings included
    #: fingerprints of the logs: `ohmward learn` does not count these logs a second time
    fingerprints: tuple[str, ...] = ()


@dataclass(frozen=True)
class Battery(RichDisplay):
    """Battery, a cell or a pack. All voltages and resistances are those of the whole pack.

    >>> battery = ow.load_battery("battery.toml")
    >>> battery.n_series, battery.chemistry, battery.capacity_Ah
    (4, 'lfp', 12.0)
    """

    name: str  #: name for people
    capacity_Ah: float  #: charge between full and empty, > 0
    chemistry: str = ""  #: such as "lfp"; empty if unknown
    n_series: int = 1  #: cells in series
    #: voltage range of the test logs, or the usual one of the chemistry
    voltage_min_V: float = 0.0
    voltage_max_V: float = 1000.0
    #: true current at rest (<= 0; 0 in a laboratory): every rest then shows the offset of the current sensor. Leave it
    #: out if unknown
    idle_current_A: float | None = None
    thevenin: Thevenin = field(kw_only=True)  #: equivalent circuit
    noise: BatteryNoise = field(default_factory=BatteryNoise)  #: errors of the circuit that an estimator assumes
    sensor: CurrentSensor = field(default_factory=CurrentSensor)  #: current sensor of the robot
    #: logs and methods behind the numbers; absent if they come from a data sheet
    identification: Provenance | None = None
    not_identified: tuple[str, ...] = ()  #: parameters that could not be identified, and why
    serial_number: str = ""  #: of this individual battery; empty if unknown
    knowledge: Knowledge | None = None  #: what everyday logs have added; absent if none

    def __post_init__(self) -> None:
        require_positive("capacity_Ah", self.capacity_Ah)
        require_between("n_series", self.n_series, 1, float("inf"))
        if isinstance(self.n_series, bool) or self.n_series != int(self.n_series):
            raise InputError(f"n_series must be a whole number of cells, got {self.n_series!r}")
        object.__setattr__(self, "n_series", int(self.n_series))
        object.__setattr__(self, "capacity_Ah", float(self.capacity_Ah))
        if self.idle_current_A is not None:
            require_between("idle_current_A", self.idle_current_A, -self.capacity_Ah, 0.0)
        if not self.voltage_min_V < self.voltage_max_V:
            raise InputError(
                f"voltage_min_V must be below voltage_max_V, got {self.voltage_min_V:g} and {self.voltage_max_V:g}"
            )
        if self.thevenin.capacity_Ah != self.capacity_Ah:
            raise InputError(
                f"battery {self.name!r} has {self.capacity_Ah:g} Ah and its model thevenin "
                f"{self.thevenin.capacity_Ah:g}; give both the same"
            )

    def __repr__(self) -> str:
        cells = f"{self.n_series} {self.chemistry} in series" if self.chemistry else f"{self.n_series} in series"
        volts = f"{self.voltage_min_V:.4g} to {self.voltage_max_V:.4g} V"
        logs = f", logs learnt from: {len(self.learnt_logs)}" if self.learnt_logs else ""
        return f"Battery({self.name!r}, {cells}, {self.capacity_Ah:.4g} Ah, {volts}{logs})"

    @property
    def learnt_logs(self) -> tuple[SeenLog, ...]:
        """Logs that it has learnt from, in their order."""
        return self.knowledge.logs if self.knowledge else ()

    @property
    def curve_seen_from_soc(self) -> float:
        """State of charge down to which the logs have shown its curve, 1 without logs."""
        return self.knowledge.seen_from_soc if self.knowledge else 1.0

    @property
    def pinned(self) -> Battery:
        """The battery whose curve slips as far as logs, rather than age, leave its capacity open.

        Logs show the curve over the charge below full. So an error of the capacity moves it along SoC by 1 - s for each
        unit of the loss, down to the lowest SoC seen, and below that less and less to empty; `slip_shape` times a
        factor is like that. A later loss moves it by the slip of the electrodes. Both are weighted by their variances.
        """
        if self.knowledge is None:
            return self
        low = min(max(self.knowledge.seen_from_soc, float(_SOC[1])), 1.0)
        shape, at_full = slip_shape(_SOC, 1.0), np.minimum(1.0 - _SOC, (1.0 - low) / low * _SOC)
        factor = float(shape @ at_full / (shape @ shape))
        own, own_std = self.thevenin.ocv_slip, self.noise.ocv_slip_std
        open_share = self.noise.capacity_std**2 / (self.noise.capacity_std**2 + _LOST_SINCE**2)
        aged_share = 1.0 - open_share
        variance = open_share * _PINNED_STD**2 + aged_share * own_std**2 + open_share * aged_share * (factor - own) ** 2
        slip = open_share * factor + aged_share * own
        noise = replace(self.noise, ocv_slip_std=math.sqrt(variance))
        return replace(self, thevenin=replace(self.thevenin, ocv_slip=slip), noise=noise)


def require_battery(battery: object, others: str = "") -> Battery:
    """The battery itself; InputError for anything else, such as the path of a file.

    others: what else is accepted, in words.
    """
    if not isinstance(battery, Battery):
        raise InputError(
            f"battery must be a Battery{others}, got {type(battery).__name__}; load_battery(path) reads one, "
            "identify(logs, capacity_Ah=...) makes one"
        )
    return battery
