"""Tables as MCAP: read back by others and by ohmward."""

import numpy as np
import pytest

from ohmward.logs import Log, read_log, write_log, write_table
from ohmward.logs.read import open_table

pytest.importorskip("mcap")


def columns(n: int = 500) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(5)
    current_A = np.where((np.arange(n) // 50) % 2 == 0, -5.0, 0.0)
    return {
        "time_s": 0.1 * np.arange(n),
        "current_A": current_A,
        "voltage_V": 12.6 + 0.05 * current_A + rng.normal(0.0, 1e-3, n),
        "cell_voltage[0]": np.where(np.arange(n) % 3 == 0, np.nan, 3.3),
        "flags": np.arange(n),
    }


def test_other_readers_decode_every_number(tmp_path):
    """The package rosbags takes the definition from the file."""
    highlevel, typesys = pytest.importorskip("rosbags.highlevel"), pytest.importorskip("rosbags.typesys")
    path, known = tmp_path / "t.mcap", columns()
    write_table(known, path)
    with highlevel.AnyReader([path], default_typestore=typesys.get_typestore(typesys.Stores.EMPTY)) as reader:
        rows = [reader.deserialize(raw, topic.msgtype) for topic, _, raw in reader.messages()]
    for name, values in known.items():
        field = name.replace("[", "_").replace("]", "")
        np.testing.assert_array_equal([getattr(row, field) for row in rows], values)
    assert [row.header.stamp.sec * 10**9 + row.header.stamp.nanosec for row in rows] == [
        100_000_000 * k for k in range(500)
    ]


def test_a_log_comes_back(tmp_path):
    known = columns()
    log = Log("day", known["time_s"], known["current_A"], known["voltage_V"], start_unix_s=1.7e9)
    write_log(log, tmp_path / "day.mcap")
    again = read_log(tmp_path / "day.mcap")
    np.testing.assert_array_equal(again.voltage_V, log.voltage_V)
    np.testing.assert_allclose(again.time_s, log.time_s, atol=1e-6)
    assert again.start_unix_s == pytest.approx(1.7e9)


def test_the_clock_of_a_log_without_a_date_stays_without_one(tmp_path):
    write_table(columns(), tmp_path / "t.mcap")
    again = read_log(tmp_path / "t.mcap")
    assert again.start_unix_s is None
    np.testing.assert_allclose(again.time_s, columns()["time_s"], atol=1e-9)


def test_names_that_become_equal_stay_apart(tmp_path):
    names = ["a b", "a-b", "a_b", "1", "%"]
    write_table({name: np.arange(3.0) + k for k, name in enumerate(names)}, tmp_path / "t.mcap")
    file = open_table(tmp_path / "t.mcap")
    table = file.load(file.names)
    assert [table.columns[name][0] for name in ("a_b", "a_b_again1", "a_b_again2", "column_1", "column")] == [*range(5)]
