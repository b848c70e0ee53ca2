"""Logs in JSON: columns or rows, wherever they stand in the file."""

import json

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import read_log

COLUMNS: dict[str, list] = {"time_s": [0, 1, 2], "current_A": [-1.0, -2.0, -1.0], "voltage_V": [12.5, 12.4, 12.5]}
ROWS = [{name: values[k] for name, values in COLUMNS.items()} for k in range(3)]
BY_ROW = {name: dict(zip("012", values, strict=True)) for name, values in COLUMNS.items()}


@pytest.mark.parametrize(
    "content",
    [
        {"robot": "mower", "log": COLUMNS},
        {"time_s": COLUMNS["time_s"], "battery": {name: COLUMNS[name] for name in ("current_A", "voltage_V")}},
        {"robot": {"name": "mower", "wheels": [1, 2, 3]}, "samples": ROWS},
        {"data": {"rate_hz": 1, "samples": ROWS}},
        {"schema": {"fields": [{"name": "time_s", "type": "number"}, {"name": "current_A"}]}, "data": ROWS},
        [
            {"time": t, "current": f"{1e3 * i:g} mA", "voltage": f"{u} V"}
            for t, i, u in zip(*COLUMNS.values(), strict=True)
        ],
        {**BY_ROW, "robot": "mower"},
        {**BY_ROW, "robot": {"name": "mower"}},
        [None, *ROWS, "end"],
    ],
)
def test_columns_and_rows_are_found_beside_other_values(content, tmp_path):
    path = tmp_path / "log.json"
    path.write_text(json.dumps(content))
    log = read_log(path, current_sign="charge")
    np.testing.assert_array_equal([log.time_s, log.current_A, log.voltage_V], list(COLUMNS.values()))


def test_lists_of_another_length_are_named(tmp_path):
    path = tmp_path / "log.json"
    path.write_text(json.dumps(COLUMNS | {"limits_V": [10.0, 14.6]}))
    assert "warning: lists of another length left out: limits_V" in map(
        str, read_log(path, current_sign="charge").notes
    )


@pytest.mark.parametrize(
    "content",
    [
        {"columns": 3, "data": 4},
        {"columns": ["a"], "data": {"x": 1}},
        {"t": [1, {"a": 1}], "I": [1, [2]]},
        {},
        [],
        [[]],
    ],
)
def test_what_is_no_table_is_refused(content, tmp_path):
    path = tmp_path / "log.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(InputError, match=r"^log.json: "):
        read_log(path)
