"""Health of a battery from its logs: learn from each in order of time, then judge the trend."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ohmward.battery.battery import Battery, require_battery
from ohmward.battery.health.ageing import WORN_SHARE
from ohmward.battery.health.health import Health, health_of
from ohmward.battery.health.history import (
    DatedLogs,
    Newness,
    common_error,
    in_order_of_time,
    newness,
    points_of,
    unlearnt,
)
from ohmward.battery.learning.learn import learn
from ohmward.battery.learning.log_update import LogUpdate
from ohmward.checks import require_positive
from ohmward.errors import InputError
from ohmward.logs.log import LogSource, as_logs
from ohmward.rich_display import RichDisplay

#: Seed of the batteries that are drawn for the time left: equal logs give equal answers.
_SEED = 1


@dataclass(frozen=True, eq=False, repr=False)
class BatteryHealth(RichDisplay):
    """Logs of a battery, what each taught, and the health that follows."""

    battery: Battery
    new: Newness  #: capacity and resistance that the health is measured against
    dated: DatedLogs  #: the logs in order of time
    updates: Sequence[LogUpdate]  #: one for each log
    health: Health  #: trends, sudden changes, and the time left

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed of the time and of the battery when new."""
        return (*self.dated.notes, *self.new.notes)

    def __repr__(self) -> str:
        capacity, resistance = np.exp(self.health.capacity_now.mean), np.exp(self.health.resistance_now.mean)
        return (
            f"BatteryHealth({self.battery.name!r}, {len(self.updates)} logs, capacity {100 * capacity:.0f} "
            f"%, resistance {100 * resistance:.0f} % of those when new)"
        )


def health(
    battery: Battery,
    logs: LogSource | Sequence[LogSource],
    *,
    new_capacity_Ah: float | None = None,
    worn: float = WORN_SHARE,
    progress: Callable[[str, float], None] | None = None,
) -> BatteryHealth:
    """Capacity and resistance against new over months of logs, sudden changes, and the time left.

    >>> found = ow.health(ow.load_battery("battery.toml"), ["day.csv", "next-day.csv"])
    >>> found.plot().save("health.html")

    battery: as it was when new.
    logs: in any order where they have clocks; or paths or DataFrames of them.
    new_capacity_Ah: of the battery when new; by default the battery file's.
    worn: share of the capacity when new, to which the time left counts.
    progress: called with the name of a log and the share of all that is done.

    Raises:
        InputError: some logs have a clock and some have none, or no log tells the health of this battery.
    """
    require_battery(battery)
    require_positive("worn", worn)
    dated = in_order_of_time(as_logs(logs))
    learnt = learn(unlearnt(battery), dated.logs, progress=progress)
    if not any(update.verdict == "learnt" for update in learnt.updates):  # the health would be that of the label
        first = learnt.updates[0]
        raise InputError(
            f"no log tells the health of this battery ({len(learnt.updates)} given); {first.log}: {first.reason}"
        )
    new = newness(battery, learnt.updates, new_capacity_Ah)
    points = points_of(dated, learnt.updates, new)
    common = common_error(learnt.battery, learnt.updates)
    found = health_of(battery, points, np.random.default_rng(_SEED), worn, common)
    return BatteryHealth(battery, new, dated, learnt.updates, found)
