"""A fleet's live samples as a stream through Spark: one estimator for each robot, its state in Spark's checkpoint."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ohmward.battery.file import BATTERY_FILE
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import DEFAULT, make_estimator
from ohmward.errors import InputError, OhmwardError
from ohmward.optional import require

if TYPE_CHECKING:
    from pandas import DataFrame as PandasFrame
    from pyspark.sql import DataFrame

#: Columns of the samples, and of the estimates.
MEASURED = ("time_s", "current_A", "voltage_V", "temperature_degC")
ESTIMATED = ("soc", "soc_std", "current_offset_A", "soh_capacity", "resistance_ratio")
SCHEMA = f"robot string, time_s double, {', '.join(f'{name} double' for name in ESTIMATED)}, flags int"


def soc_stream(
    samples: DataFrame,
    battery: str,
    filter: str = DEFAULT,
    initial_soc: float | None = None,
    initial_soc_std: float = 0.03,
) -> DataFrame:
    """Estimates for a streaming DataFrame, a row of `SCHEMA` for each of its rows.

    Within a micro-batch the rows of a robot are taken in order of time, because Spark keeps no other; a row that is
    late for its micro-batch is used as `SocEstimator.update` says. Bad values are flagged, see `SocFlag`.

    samples: columns robot and `MEASURED`; null is no measurement.
    battery: text of the battery file of all robots.

    Raises:
        InputError: a column is missing, or the battery file cannot be read or lacks the model that the filter needs.
        OhmwardError: pyspark is older than 4.0 or not installed.
    """
    functions = _functions(samples)
    if missing := [name for name in ("robot", *MEASURED) if name not in samples.columns]:
        raise InputError(f"samples must have the column {missing[0]!r}, got {', '.join(samples.columns)}; add it")
    robot: Any = SocOfRobot(battery, filter, initial_soc, initial_soc_std)
    robot.estimator()  # refused now, not on the executors
    columns = [functions.col("robot").cast("string"), *(functions.col(name).cast("double") for name in MEASURED)]
    by_robot = samples.select(*columns).groupBy("robot")
    return by_robot.transformWithStateInPandas(robot, SCHEMA, "Append", "None")


class SocOfRobot:
    """A `pyspark.sql.streaming.StatefulProcessor` for each robot; its state is the estimator's snapshot as JSON."""

    def __init__(self, battery: str, filter: str, initial_soc: float | None, initial_soc_std: float):
        self.battery, self.filter = battery, filter
        self.initial_soc, self.initial_soc_std = initial_soc, initial_soc_std

    def estimator(self, snapshot: str | None = None) -> SocEstimator:
        """A new one, or the one that goes on from a snapshot in JSON."""
        settings = make_estimator(self.filter, BATTERY_FILE.parse(self.battery))
        if snapshot is not None:
            return SocEstimator.restore(settings, json.loads(snapshot))
        return SocEstimator(settings, self.initial_soc, self.initial_soc_std)

    def init(self, handle: Any) -> None:
        """Before the first row of a task."""
        self._state = handle.getValueState("estimator", "snapshot string")

    def handleInputRows(self, key: Any, rows: Iterator[PandasFrame], timer_values: Any) -> Iterator[PandasFrame]:
        """The estimates of one robot in one micro-batch."""
        pandas = require("pandas", "the stream")

        frame = pandas.concat(list(rows)).sort_values("time_s", kind="stable")
        estimator = self.estimator(self._state.get()[0] if self._state.exists() else None)
        yield estimates(key[0], frame, estimator)
        self._state.update((json.dumps(estimator.snapshot()),))

    def close(self) -> None:
        """After the last row of a task."""


def estimates(robot: str, frame: PandasFrame, estimator: SocEstimator) -> PandasFrame:
    """The rows of `SCHEMA` for rows of `MEASURED`; the estimator goes on."""
    pandas = require("pandas", "the stream")

    samples = frame[list(MEASURED)].astype(float).fillna(math.nan).itertuples(index=False, name=None)
    found = [estimator.update(*sample) for sample in samples]
    columns = {name: [getattr(estimate, name) for estimate in found] for name in ESTIMATED}
    flags = [int(estimate.flags) for estimate in found]
    return pandas.DataFrame({"robot": robot, "time_s": frame["time_s"].to_numpy(), **columns, "flags": flags})


def _functions(samples: DataFrame) -> Any:
    functions = require("pyspark.sql.functions", "the stream")
    if not hasattr(samples.groupBy(), "transformWithStateInPandas"):
        raise OhmwardError("the stream needs pyspark 4.0 or later: pip install 'pyspark>=4.0'")
    return functions
