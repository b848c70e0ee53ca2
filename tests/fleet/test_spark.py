"""A stream that is stopped and started again gives what one estimator gives that never stopped."""

import math
import os
import shutil
import sys
from typing import Any

import numpy as np
import pytest

from battery.test_log_reading import BATTERY as CELL
from battery.test_log_reading import RAMP_S, pulses, ramp
from fleet import examples
from ohmward.battery.file import BATTERY_FILE
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import DEFAULT, make_estimator
from ohmward.errors import InputError
from ohmward.fleet.spark import ESTIMATED, sign_of_fleet, soc_stream
from ohmward.logs import Log
from ohmward.logs.log import UnknownSignError
from ohmward.trace.kernel import repeatable_lowering

pytest.importorskip("pyspark", reason="needs Spark: pip install pyspark")
if shutil.which("java") is None:
    pytest.skip("Spark needs Java 17 or later; install a Java runtime", allow_module_level=True)

SAMPLES = "robot string, time_s double, current_A double, voltage_V double, temperature_degC double"
ROBOTS = ("ada", "bob", "eve")
BATTERY = examples.job().battery
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def spark():
    from pyspark.sql import SparkSession

    os.environ["PYSPARK_PYTHON"] = sys.executable
    provider = "org.apache.spark.sql.execution.streaming.state.RocksDBStateStoreProvider"
    settings: dict[str, Any] = {
        "spark.sql.shuffle.partitions": "2",
        "spark.ui.enabled": "false",
        "spark.sql.streaming.stateStore.providerClass": provider,
    }
    session = SparkSession.builder.master("local[2]").config(map=settings).getOrCreate()
    session.sparkContext.setLogLevel("ERROR")
    yield session
    session.stop()


def rows(seed: int) -> np.ndarray:
    """(60, 4) of a robot: time, current, voltage, temperature."""
    rng = np.random.default_rng(seed)
    current = rng.normal(-1.0, 0.5, 60)
    return np.column_stack([np.arange(60.0), current, 3.8 + 0.05 * current - 0.001 * np.arange(60), np.full(60, 25.0)])


def write(spark, folder, part: slice, samples: dict) -> None:
    """The part of every robot as one more file, in no order."""
    listed = [(robot, *map(_or_none, row)) for robot in samples for row in samples[robot][part]]
    shuffled = [listed[i] for i in np.random.default_rng(1).permutation(len(listed))]
    spark.createDataFrame(shuffled, SAMPLES).coalesce(1).write.mode("append").parquet(str(folder))


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def stream(spark, folder, out, checkpoint, **options) -> dict[str, np.ndarray]:
    """Run over all that is new, then stop; rows so far by robot in order of their time."""
    found = soc_stream(spark.readStream.schema(SAMPLES).parquet(str(folder)), BATTERY, **options)
    writer = found.writeStream.format("parquet").option("checkpointLocation", str(checkpoint))
    writer.trigger(availableNow=True).start(str(out)).awaitTermination()
    listed = spark.read.parquet(str(out)).collect()
    by_robot: dict[str, list] = {}
    for row in sorted(listed, key=lambda row: (row.time_s is None, row.time_s)):
        by_robot.setdefault(row.robot, []).append([_number(row[name]) for name in ("time_s", *ESTIMATED, "flags")])
    return {robot: np.array(values) for robot, values in by_robot.items()}


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def never_stopped(samples: np.ndarray) -> np.ndarray:
    settings = make_estimator(DEFAULT, BATTERY_FILE.parse(BATTERY))
    estimator = SocEstimator(settings, lowering=repeatable_lowering())
    found = [(row[0], estimator.update(*map(float, row))) for row in samples]
    return np.array([[time_s, *(getattr(e, name) for name in ESTIMATED), int(e.flags)] for time_s, e in found])


def test_a_stream_that_was_stopped_gives_what_was_never_stopped(spark, tmp_path):
    samples = {robot: rows(k) for k, robot in enumerate(ROBOTS)}
    write(spark, tmp_path / "in", slice(0, 25), samples)
    stream(spark, tmp_path / "in", tmp_path / "out", tmp_path / "state")
    write(spark, tmp_path / "in", slice(25, 60), samples)
    stopped = stream(spark, tmp_path / "in", tmp_path / "out", tmp_path / "state")
    at_once = stream(spark, tmp_path / "in", tmp_path / "out2", tmp_path / "state2")
    assert set(stopped) == set(ROBOTS)
    for robot in ROBOTS:
        np.testing.assert_array_equal(stopped[robot], never_stopped(samples[robot]))
        np.testing.assert_array_equal(at_once[robot], stopped[robot])


def test_bad_rows_are_flagged_and_a_late_one_is_used_as_live(spark, tmp_path):
    samples = rows(0)[:20]
    samples[3, 1] = samples[5, 2] = samples[7, 3] = math.nan
    late = np.array([[12.5, -1.0, 3.75, 25.0]])
    write(spark, tmp_path / "in", slice(None), {"ada": samples})
    stream(spark, tmp_path / "in", tmp_path / "out", tmp_path / "state")
    write(spark, tmp_path / "in", slice(None), {"ada": late})
    found = stream(spark, tmp_path / "in", tmp_path / "out", tmp_path / "state")["ada"]
    expected = never_stopped(np.vstack([samples, late]))
    np.testing.assert_array_equal(found, expected[np.argsort(expected[:, 0])])
    assert found[3, -1] and found[5, -1]


def test_a_stream_whose_positive_current_discharges(spark, tmp_path):
    samples = rows(0)[:20]
    write(spark, tmp_path / "in", slice(None), {"ada": samples * [1.0, -1.0, 1.0, 1.0]})
    found = stream(spark, tmp_path / "in", tmp_path / "out", tmp_path / "state", current_sign="discharge")["ada"]
    np.testing.assert_array_equal(found, never_stopped(samples))


def history(spark, logs: dict):
    listed = [
        (robot, float(t), float(i), float(u), 25.0)
        for robot, log in logs.items()
        for t, i, u in zip(log.time_s, log.current_A, log.voltage_V, strict=True)
    ]
    return spark.createDataFrame(listed, SAMPLES)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_robots_that_tell_the_sign_tell_it_of_all_and_else_the_battery_file_does(spark, sign):
    battery, expected = BATTERY_FILE.dump(CELL), "charge" if sign > 0 else "discharge"
    assert sign_of_fleet(history(spark, {"ada": ramp(sign), "bob": pulses(sign)}), battery) == expected
    assert sign_of_fleet(history(spark, {"ada": ramp(sign), "eve": ramp(sign)}), battery) == expected


def test_a_sign_that_nobody_tells_or_robots_contradict_is_refused(spark):
    rest = Log("rest", RAMP_S, np.zeros(RAMP_S.size), np.full(RAMP_S.size, 3.7))
    battery = BATTERY_FILE.dump(CELL)
    with pytest.raises(UnknownSignError, match="the samples of 1 robot do not show"):
        sign_of_fleet(history(spark, {"ada": rest}), battery)
    with pytest.raises(UnknownSignError, match="the samples of 2 robots do not show"):
        sign_of_fleet(history(spark, {"ada": pulses(1.0), "bob": pulses(-1.0)}), battery)
    with pytest.raises(InputError, match="current_sign must be 'charge' or 'discharge', not 'auto'"):
        soc_stream(history(spark, {"ada": rest}), battery, current_sign="auto")


def test_a_missing_column_is_refused(spark):
    with pytest.raises(InputError, match="must have the column 'voltage_V'"):
        soc_stream(spark.createDataFrame([("ada", 0.0, 1.0)], "robot string, time_s double, current_A double"), BATTERY)
