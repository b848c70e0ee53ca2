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


def test_a_cell_that_is_stuck_is_left_out_from_there_on_and_named():
    names = [f"cell_{k}" for k in range(1, 5)]
    stuck_from = columns(names) | {"cell_2": np.where(np.arange(50) < 10, CELLS_V[:, 1], CELLS_V[9, 1])}
    found, (_, warning) = find_cells(stuck_from, PACK_V, 4)
    assert found is not None
    assert np.isnan(found.voltage_V[10:, 1]).all()
    assert found.voltage_V[:10] == pytest.approx(CELLS_V[:10])
    assert found.voltage_V[:, [0, 2, 3]] == pytest.approx(CELLS_V[:, [0, 2, 3]])
    assert warning.level == "warning" and "'cell_2' is stuck" in warning.text and "in 40 rows" in warning.text


@pytest.mark.parametrize(
    ("step_V", "scan_rows"), [(0.02, 1), (1e-4, 4)], ids=["coarse steps", "one cell after the other"]
)
def test_cells_that_repeat_their_values_are_not_stuck(step_V, scan_rows):
    """A drive whose current moves all cells by 40 mV, beside stretches of rest."""
    rows, rng = np.arange(4000), np.random.default_rng(3)
    load_V = np.where(rows // 500 % 2, 0.02 * np.sin(rows / 9.0), 0.0)
    read = [(rows - k) // scan_rows * scan_rows + k if scan_rows > 1 else rows for k in range(4)]
    true_V = 3.3 + load_V[:, None] + 0.001 * rng.standard_normal((rows.size, 4))
    cells_V = np.stack([true_V[np.clip(at, 0, None), k] for k, at in enumerate(read)], axis=1)
    cells_V = np.round(cells_V / step_V) * step_V
    _, notes = find_cells({f"cell_{k}": cells_V[:, k] for k in range(4)}, cells_V.sum(axis=1), 4)
    assert [note.level for note in notes] == ["info"]
