"""Input, output and protocol of every estimator of the battery, one sample at a time: plain numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from ohmward.checks import require_finite, require_positive
from ohmward.errors import InputError
from ohmward.filters.flags import SampleFlag

#: Standard deviation of a given initial state of charge, unless the caller gives another one.
INITIAL_SOC_STD = 0.03
#: Largest standard deviation of any state of charge; more is a percentage.
MOST_SOC_STD = 0.5


def starts_of_logs(initial_soc: float | Mapping[str, float] | None, names: Sequence[str]) -> dict[str, float]:
    """State of charge at the start of the logs where it is given, by their names; one number holds for all.

    Raises:
        InputError: a name that no log has, or a value outside 0 to 1.
    """
    if initial_soc is None:
        return {}
    starts = dict(initial_soc) if isinstance(initial_soc, Mapping) else dict.fromkeys(names, initial_soc)
    for name, soc in starts.items():
        if name not in names:
            raise InputError(f"initial_soc names {name!r}, but the logs are {', '.join(map(repr, names))}")
        require_finite(f"initial_soc of {name!r}", soc)
        if not 0.0 <= soc <= 1.0:
            raise InputError(f"initial_soc of {name!r} must be between 0 and 1 (0.8 is 80 %), got {soc:g}")
    return starts


class SocSample(NamedTuple):
    """One sample of the battery's sensors; nan where there is none.

    >>> ow.SocSample(dt_s=1.0, current_A=-2.0, voltage_V=13.1, temperature_degC=20.0).current_A
    -2.0

    dt_s: time since the sample before [s]; 0 for the first.
    current_A: measured current [A], > 0 charges.
    voltage_V: measured terminal voltage [V] of the whole pack.
    temperature_degC: of the battery.
    """

    dt_s: Any
    current_A: Any
    voltage_V: Any
    temperature_degC: Any


#: A sample in which nothing was measured.
NO_SAMPLE = SocSample(0.0, math.nan, math.nan, math.nan)


class SocEstimate(NamedTuple):
    """Estimate after a sample; quantities that the estimator does not provide are nan.

    >>> estimate = ow.SocEstimator(ow.load_battery("battery.toml")).update(0.0, current_A=-2.0, voltage_V=13.1)
    >>> 0 <= estimate.soc <= 1, estimate.soc_std > 0
    (True, True)

    soc: state of charge in [0, 1].
    soc_std: standard deviation of the state of charge.
    voltage_V: terminal voltage [V] expected before the measurement.
    voltage_std_V: standard deviation of the expected voltage [V].
    innovation_V: measured minus expected voltage [V]; nan when the voltage was not used.
    current_offset_A: current sensor's reading at zero current [A].
    current_offset_std_A: standard deviation of that reading [A].
    soh_capacity: capacity over the battery file's.
    soh_capacity_std: standard deviation of the capacity over the battery file's.
    resistance_ratio: resistance over the battery file's.
    resistance_ratio_std: standard deviation of the resistance over the battery file's.
    flags: sum of `SocFlag` values; 0 is a sample without incident.
    """

    soc: Any
    soc_std: Any
    voltage_V: Any = math.nan
    voltage_std_V: Any = math.nan
    innovation_V: Any = math.nan
    current_offset_A: Any = math.nan
    current_offset_std_A: Any = math.nan
    soh_capacity: Any = math.nan
    soh_capacity_std: Any = math.nan
    resistance_ratio: Any = math.nan
    resistance_ratio_std: Any = math.nan
    flags: Any = 0.0


#: States in an estimate, and the fields with their standard deviations.
STD_OF = {
    "soc": "soc_std",
    "current_offset_A": "current_offset_std_A",
    "soh_capacity": "soh_capacity_std",
    "resistance_ratio": "resistance_ratio_std",
}

#: States that an estimator learns besides SoC.
LEARNT = tuple(STD_OF)[1:]

#: Fields of these states and of their standard deviations.
LEARNT_FIELDS = tuple(name for mean in LEARNT for name in (mean, STD_OF[mean]))


class SocFlag(SampleFlag):
    """Incidents at a sample. None of them stops an estimator.

    >>> ow.SocEstimator(ow.load_battery("battery.toml")).update(0.0, current_A=None, voltage_V=13.1).flags
    SocFlag.NO_CURRENT
    """

    NO_CURRENT = 1  # missing or impossible: the last current was held, and faded
    NO_VOLTAGE = 2  # missing or impossible: predicted only
    BAD_TIME = 4  # dt_s not a number, negative or over a year: 0 was used; dt_s = 0 is a repeated sample
    GAP = 8  # step too long to assume a straight line between its two currents
    VOLTAGE_REJECTED = 16  # innovation outside its gate, or a jump that has not lasted yet
    REST = 32  # current known: the zero-current update was made
    SOC_LIMITED = 64  # estimate projected into [0, 1]
    NOT_POSITIVE_DEFINITE = 128  # the covariance had to be repaired; by a filter of the laboratory alone
    DIVERGED = 256  # the voltage has contradicted the estimate for too long: SoC was declared unknown
    RESTARTED = 512  # in Python: started again from this sample: a wrong or missing first voltage, or a state of NaN
    ANCHORED = 1024  # a full charge, the steep end of a flat curve or the cut-off of a load corrected SoC
    MISFIT = 2048  # an offset or a capacity that sensor and battery cannot have: another battery's file?
    EXCHANGED = 4096  # in Python: the voltage stepped over a silence: another battery is in, and started from here


def require_soc_std(name: str, soc_std: float) -> None:
    """Raise InputError unless a standard deviation of the state of charge is > 0 and at most `MOST_SOC_STD`."""
    require_positive(name, soc_std)
    if soc_std > MOST_SOC_STD:
        raise InputError(f"{name} must be at most {MOST_SOC_STD:g} (0.03 is 3 points), got {soc_std:g}")


class Estimator(Protocol):
    """Frozen settings with two pure functions."""

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> Any:
        """State before the first sample; `soc` None is unknown."""
        ...

    def step(self, state: Any, sample: SocSample) -> tuple[Any, SocEstimate]:
        """State and estimate after a sample."""
        ...
