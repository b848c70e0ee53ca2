"""A fleet's live samples as a stream through Spark: one estimator for each robot, its state in Spark's checkpoint."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ohmward.battery.file import BATTERY_FILE
from ohmward.battery.log_check import sign_by_model
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import DEFAULT, make_estimator
from ohmward.battery.soc.sample import INITIAL_SOC_STD
from ohmward.errors import InputError, OhmwardError
from ohmward.logs.log import Log, UnknownSignError
from ohmward.logs.table import counted
from ohmward.optional import require
from ohmward.signals.current_sign import CurrentSign, sign_evidence
from ohmward.trace.kernel import repeatable_lowering

if TYPE_CHECKING:
    from pandas import DataFrame as PandasFrame
    from pyspark.sql import DataFrame

#: Columns of the samples, and of the estimates.
MEASURED = ("time_s", "current_A", "voltage_V", "temperature_degC")
ESTIMATED = ("soc", "soc_std", "current_offset_A", "soh_capacity", "resistance_ratio")
SCHEMA = f"robot string, time_s double, {', '.join(f'{name} double' for name in ESTIMATED)}, flags int"

#: Most robots whose samples are examined for the sign of the current.
_MOST_ROBOTS = 9


def soc_stream(
    samples: DataFrame,
    battery: str,
    filter: str = DEFAULT,
    initial_soc: float | None = None,
    initial_soc_std: float = INITIAL_SOC_STD,
    current_sign: CurrentSign = "charge",
) -> DataFrame:
    """Estimates for a streaming DataFrame, a row of `SCHEMA` for each of its rows.

    Within a micro-batch the rows of a robot are sorted by time, because Spark keeps no order; a row that comes too late
    for its micro-batch is treated as in `SocEstimator.update`. Bad values are flagged, see `SocFlag`.

    samples: columns robot and `MEASURED`; null is no measurement.
    battery: text of the battery file of all robots.
    current_sign: effect of a positive current, "charge" or "discharge"; `sign_of_fleet` finds it.

    Raises:
        InputError: a column is missing, the sign is neither, or the battery file cannot be read or lacks the model
            that the filter needs.
        OhmwardError: pyspark is older than 4.0 or not installed.
    """
    functions = _functions(samples)
    if current_sign not in ("charge", "discharge"):
        raise InputError(f"current_sign must be 'charge' or 'discharge', not {current_sign!r}; see sign_of_fleet")
    robot: Any = SocOfRobot(battery, filter, initial_soc, initial_soc_std)
    robot.estimator()  # refused now, not on the executors
    by_robot = _measured(samples, functions, 1.0 if current_sign == "charge" else -1.0).groupBy("robot")
    return by_robot.transformWithStateInPandas(robot, SCHEMA, "Append", "None")


def sign_of_fleet(history: DataFrame, battery: str) -> CurrentSign:
    """Effect of a positive current in the samples of a fleet, from their own data or by the battery file.

    All robots whose own samples show a sign must agree; if none does, the voltages must show it by the battery file.

    history: a static DataFrame with the columns of `soc_stream`; hours of a few robots are enough.
    battery: text of the battery file of all robots.

    Raises:
        InputError: a column is missing.
        UnknownSignError: neither the samples nor the battery file show the sign.
        OhmwardError: pyspark is older than 4.0 or not installed.
    """
    samples = _measured(history, _functions(history), 1.0)
    robots = sorted(row.robot for row in samples.select("robot").distinct().collect())
    robots = robots[:: max(len(robots) // _MOST_ROBOTS, 1)][:_MOST_ROBOTS]  # spread over all of them
    chosen = samples.where(samples.robot.isin(*robots)).groupBy("robot")
    votes = chosen.applyInPandas(lambda frame: _votes(battery, frame), "own string, by_model string").collect()
    own = {vote.own for vote in votes} - {None}
    signs = own or {vote.by_model for vote in votes} - {None}
    if len(signs) != 1:
        raise UnknownSignError(
            f"the samples of {counted(len(votes), 'robot')} do not show whether a positive current charges or "
            "discharges the battery; say it with current_sign='charge' or current_sign='discharge'",
            "charge",
        )
    return signs.pop()


def _votes(battery: str, frame: PandasFrame) -> PandasFrame:
    """The sign that the samples of one robot show, and the one by the battery file, null for none."""
    pandas = require("pandas", "the stream")

    frame = frame.dropna(subset=["time_s"]).drop_duplicates("time_s").sort_values("time_s")
    own = by_model = None
    if len(frame):
        log = Log("samples", *(frame[name].to_numpy(float) for name in MEASURED[:3]))
        verdict = sign_evidence(log.time_s, log.current_A, log.voltage_V).verdict
        own = None if verdict == "undecidable" else verdict
        by_model = sign_by_model(log, BATTERY_FILE.parse(battery))
    return pandas.DataFrame({"own": [own], "by_model": [by_model]})


def _measured(samples: DataFrame, functions: Any, sign: float) -> DataFrame:
    """The columns that are needed, the current times `sign`; InputError where one is missing."""
    if missing := [name for name in ("robot", *MEASURED) if name not in samples.columns]:
        raise InputError(f"samples must have the column {missing[0]!r}, got {', '.join(samples.columns)}; add it")
    columns = {name: functions.col(name).cast("double") for name in MEASURED}
    columns["current_A"] = (sign * columns["current_A"]).alias("current_A")
    return samples.select(functions.col("robot").cast("string"), *columns.values())


class SocOfRobot:
    """A `pyspark.sql.streaming.StatefulProcessor` for each robot; its state is the estimator's snapshot as JSON."""

    def __init__(self, battery: str, filter: str, initial_soc: float | None, initial_soc_std: float):
        self.battery, self.filter = battery, filter
        self.initial_soc, self.initial_soc_std = initial_soc, initial_soc_std

    def estimator(self, snapshot: str | None = None) -> SocEstimator:
        """A new estimator, or one restored from a snapshot in JSON; a stream that is restarted gives the same bits."""
        settings, lowering = make_estimator(self.filter, BATTERY_FILE.parse(self.battery)), repeatable_lowering()
        if snapshot is not None:
            return SocEstimator.restore(settings, json.loads(snapshot), lowering=lowering)
        return SocEstimator(settings, self.initial_soc, self.initial_soc_std, lowering)

    def init(self, handle: Any) -> None:
        """Prepare the state before the first row of a task."""
        self._state = handle.getValueState("estimator", "snapshot string")

    def handleInputRows(self, key: Any, rows: Iterator[PandasFrame], timer_values: Any) -> Iterator[PandasFrame]:
        """The estimates of one robot in one micro-batch."""
        pandas = require("pandas", "the stream")

        frame = pandas.concat(list(rows)).sort_values("time_s", kind="stable")
        estimator = self.estimator(self._state.get()[0] if self._state.exists() else None)
        yield estimates(key[0], frame, estimator)
        self._state.update((json.dumps(estimator.snapshot()),))

    def close(self) -> None:
        """Nothing to do after the last row of a task."""


def estimates(robot: str, frame: PandasFrame, estimator: SocEstimator) -> PandasFrame:
    """The rows of `SCHEMA` for rows of `MEASURED`; advances the estimator."""
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
