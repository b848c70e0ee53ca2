"""The measured NMC cell beside the simulated pack of [T]: its tables, and the drive where the records are there."""

import numpy as np
import pytest

from needs import DATA, measured_file
from ohmward_lab.reproduce.measured import FOLDER, by_soc, first_soc, gitt_voltage, nmc_item


def test_the_start_is_the_authors_and_full_where_they_give_none(tmp_path):
    (tmp_path / "index.csv").write_text(
        "cell,test,scalars\nnmc,drive,\"{'initial_soc': 0.952, 'battery_capacity': 3440.0}\"\nnmc,charge,{}\n"
    )
    assert first_soc(tmp_path, "nmc", "drive") == 0.952
    assert first_soc(tmp_path, "nmc", "charge") == 1.0


def test_the_open_circuit_voltage_is_sorted_and_rises(tmp_path):
    file = tmp_path / "ocv.csv"
    file.write_text("soc_values,voltage_values\n1.0,4.2\n0.0,3.0\n0.4,3.7\n0.6,3.6\n")
    table = by_soc(file)
    np.testing.assert_array_equal(table[:, 0], [0.0, 0.4, 0.6, 1.0])
    np.testing.assert_allclose(gitt_voltage(table, np.array([0.0, 0.2, 0.4, 0.6, 1.0])), [3.0, 3.35, 3.7, 3.7, 4.2])


def test_without_the_records_the_item_names_the_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="tue_cells"):
        nmc_item(tmp_path)


def test_on_a_real_cell_voltage_and_charge_part():
    """The joint EKF follows the voltage closer than the default and loses the charge; the default does not.

    Not the UKF: what becomes of it once it has lost the charge hangs on the last digits.
    """
    measured_file(FOLDER)
    rows = {row.quantity: row for row in nmc_item(DATA).make().rows}
    assert len(rows) == 16
    voltage, charge = rows["Voltage before the sample, EKF: mean"], rows["SoC, EKF: mean"]
    assert voltage.printed == 0.02 and charge.printed == 0.18
    assert voltage.corrected and voltage.default and charge.corrected and charge.default
    assert voltage.corrected < 0.5 * voltage.default
    assert charge.default < 3.0 < charge.corrected
