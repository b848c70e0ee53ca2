import numpy as np
import pandas as pd
import pytest

from ohmward.logs import read_log
from ohmward.logs.battery_columns import find_cells, numbered_rows

RNG = np.random.default_rng(0)
CELLS_V = 3.3 + 0.01 * RNG.standard_normal((50, 4))
PACK_V = CELLS_V.sum(axis=1)


def columns(names, factor=1.0):
    return {name: factor * CELLS_V[:, k] for k, name in enumerate(names)}


@pytest.mark.parametrize(
    ("pattern", "first", "factor"),
    [
        ("cell_voltage_{}_V", 1, 1.0),
        ("cell_voltage[{}]", 0, 1.0),
        ("/battery_state/cell_voltage.{}", 0, 1.0),
        ("Cell {} (mV)", 1, 1e3),
        ("vcell{:02d}", 1, 1e3),
        ("U{}", 1, 1.0),
        ("bms.cells.{}.voltage", 0, 1.0),
    ],
)
def test_cells_are_found_by_name_and_sum(pattern, first, factor):
    names = [pattern.format(first + k) for k in range(4)]
    found, notes = find_cells({"temp_1": PACK_V, **columns(names, factor)}, PACK_V, 4)
    assert found and found.names == tuple(names)
    assert found.voltage_V == pytest.approx(CELLS_V)
    assert [note.level for note in notes] == ["info"]


def test_the_order_is_that_of_the_numbers():
    names = [f"cell_{k}" for k in range(1, 13)]
    table = 3.3 + 0.001 * np.arange(12)[None] * np.ones((5, 1))
    found, _ = find_cells({name: table[:, k] for k, name in reversed(list(enumerate(names)))}, table.sum(axis=1), 12)
    assert found and found.names == tuple(names)


def test_numbered_columns_that_are_no_cells_are_left():
    others = {f"motor_{k}": np.full(50, 3.0 * k) for k in range(1, 5)}
    found, notes = find_cells(others, PACK_V, 4)
    assert found is None and notes == ()
    assert numbered_rows(["cell_1_temp", "cell_2_temp", "cell_1_soc", "cell_2_soc", "T1_C", "T2_C"]) == []


def test_cells_whose_sum_is_not_the_pack_are_named_and_not_used():
    found, (note,) = find_cells(columns([f"cell_{k}" for k in range(4)]), 1.1 * PACK_V, 4)
    assert found is None
    assert note.level == "warning" and "not used as cell voltages" in note.text


def test_another_number_of_cells_is_named():
    found, (note,) = find_cells(columns([f"cell_{k}" for k in range(4)]), PACK_V, 6)
    assert found is None and "n_series = 6" in note.text


def test_a_single_cell_has_none():
    assert find_cells(columns(["cell_0", "cell_1"]), PACK_V, 1) == (None, ())


def test_a_pack_voltage_that_only_its_unit_names_stands_beside_cells():
    frame = {"ts_ms": 1000 * np.arange(50), **columns([f"cell_mv_{k}" for k in range(1, 5)], 1e3)}
    log = read_log(pd.DataFrame(frame | {"pack_mv": 1e3 * PACK_V, "pack_ma": -1e3}), current_sign="charge")
    assert log.voltage_V == pytest.approx(PACK_V) and log.current_A == pytest.approx(np.full(50, -1.0))


def test_the_pack_voltage_is_the_sum_where_a_log_has_cells_alone(tmp_path):
    path = tmp_path / "cells.csv"
    rows = [f"{k},-1.0,{','.join(f'{1e3 * v:.2f}' for v in row)}" for k, row in enumerate(CELLS_V)]
    path.write_text("\n".join(["time_s,current_A,Cell 1,Cell 2,Cell 3,Cell 4", *rows]))
    log = read_log(path, current_sign="charge")
    assert log.voltage_V == pytest.approx(PACK_V, abs=1e-4)
    assert any("the sum of 'Cell 1' to 'Cell 4'" in note.text for note in log.notes)
    found, _ = find_cells(log.extra, log.voltage_V, 4)
    assert found and found.voltage_V == pytest.approx(CELLS_V, abs=1e-4)
