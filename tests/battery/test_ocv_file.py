"""A table of open-circuit voltage as people have them: what is found again, what is refused."""

import numpy as np
import pytest

from battery.identification.examples import LFP_OCV, NMC_OCV, cell, identify, play, steps
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.ocv_file import given_ocv, load_ocv
from ohmward.errors import InputError

GRID = np.linspace(0.0, 1.0, 201)


def write(path, **columns):
    rows = zip(*columns.values(), strict=True)
    text = "\n".join([",".join(columns), *(",".join(f"{v:.9g}" for v in row) for row in rows)])
    path.write_text(text + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("falling", [False, True])
@pytest.mark.parametrize("soc_name, scale", [("soc", 1.0), ("SOC [%]", 100.0), ("State of Charge", 100.0)])
@pytest.mark.parametrize("voltage_name, volts", [("ocv_V", 1.0), ("OCV [mV]", 1000.0), ("voltage_values", 1.0)])
def test_a_curve_is_found_again(tmp_path, falling, soc_name, scale, voltage_name, volts):
    way = slice(None, None, -1) if falling else slice(None)
    columns = {soc_name: scale * GRID[way], voltage_name: volts * np.array(NMC_OCV.voltage_V)[way]}
    given = load_ocv(write(tmp_path / "ocv.csv", **columns))
    assert given.curve.voltage_V == pytest.approx(NMC_OCV.voltage_V, abs=1e-6)
    assert not any(given.curve.hysteresis_V)


def test_any_spacing():
    soc = np.concatenate([np.linspace(0, 0.1, 40), np.linspace(0.13, 1, 20)])
    pandas = pytest.importorskip("pandas")
    given = load_ocv(pandas.DataFrame({"soc": soc, "ocv_V": NMC_OCV.mean_V(soc, 25.0)}))
    assert np.asarray(given.curve.voltage_V) == pytest.approx(np.asarray(NMC_OCV.voltage_V), abs=1e-3)


def test_branches_give_mean_and_hysteresis(tmp_path):
    mean, half = np.array(LFP_OCV.voltage_V), np.array(LFP_OCV.hysteresis_V)
    for names in (("ocv_charge_V", "ocv_discharge_V"), ("V_chg", "V_dis"), ("charge [V]", "discharge [V]")):
        columns = {"soc": GRID, names[0]: mean + half, names[1]: mean - half}
        curve = load_ocv(write(tmp_path / "ocv.csv", **columns)).curve
        assert curve.voltage_V == pytest.approx(LFP_OCV.voltage_V, abs=1e-6)
        assert curve.hysteresis_V == pytest.approx(LFP_OCV.hysteresis_V, abs=1e-6)


@pytest.mark.parametrize("name, scale", [("dV/dT", 1.0), ("dV/dT [mV/K]", 1e3), ("dVoltage_dTemperature", 1e3)])
def test_change_with_temperature(tmp_path, name, scale):
    slope = 2e-4 + 1e-4 * GRID
    columns = {
        "soc": GRID,
        "v": 3 + GRID,
        name: scale * (slope + 0.03 * (scale > 1)),
        "temperature_K": 0 * GRID + 293.15,
    }
    curve = load_ocv(write(tmp_path / "ocv.csv", **columns)).curve
    assert curve.temperature_V_per_K == pytest.approx(tuple(slope + 0.03 * (scale > 1)), abs=1e-6)
    assert curve.reference_degC == pytest.approx(20.0)


def test_cell_or_pack_is_told_by_the_voltage():
    logs_V = np.full(10, 15.0)
    cell_curve, pack_curve = OcvCurve((3.0, 4.2)), OcvCurve((12.0, 16.8))
    from_cell, from_pack = given_ocv(cell_curve, logs_V, 4), given_ocv(pack_curve, logs_V, 4)
    assert from_cell.curve == pack_curve == from_pack.curve
    assert "multiplied by 4" in from_cell.notes[-1].text and not from_pack.notes
    with pytest.raises(InputError, match=r"runs from 3 to 4.2 V, but the logs usually show 15 V .*--n-series"):
        given_ocv(cell_curve, logs_V, 1)


def test_a_table_that_does_not_reach_the_ends_goes_straight_on(tmp_path):
    given = load_ocv(write(tmp_path / "ocv.csv", soc=[0.1, 0.5, 0.9], v=[3.1, 3.5, 3.9]))
    assert given.curve.voltage_V[0] == pytest.approx(3.0) and given.curve.voltage_V[-1] == pytest.approx(4.0)
    assert any("covers SoC 0.100 to 0.900" in note.text for note in given.notes)


def test_noise_is_levelled(tmp_path):
    given = load_ocv(write(tmp_path / "ocv.csv", soc=[0, 0.3, 0.31, 0.32, 1], v=[3.2, 3.301, 3.300, 3.302, 3.4]))
    assert np.all(np.diff(given.curve.voltage_V) >= 0)
    assert any("levelled" in note.text for note in given.notes)


@pytest.mark.parametrize(
    "columns, message",
    [
        ({"soc": [0.5], "v": [3.5]}, "at least 2 rows"),
        ({"soc": [0, 1.3], "v": [3, 4]}, "between 0 and 1 .* got 1.3"),
        ({"soc": [0, 130], "v": [3, 4]}, "between 0 and 1 .* got 1.3"),
        ({"soc": [-0.1, 1], "v": [3, 4]}, "between 0 and 1 .* got -0.1"),
        ({"soc": [0, 0.5, 1], "v": [3, 3.6, 3.4]}, "must not fall with SoC, but near SoC 0.500"),
        ({"soc": [0, 1, 0.5], "v": [3, 4, 3.5]}, "SoC turns back at 1; .*'ocv_charge_V', 'ocv_discharge_V'"),
        ({"soc": [0, 0.1], "v": [3, 3.2]}, "at least 20% of SoC"),
        ({"time": [0, 1], "v": [3, 4]}, "no column for the state of charge found; it has: 'time', 'v'"),
        ({"soc": [0, 1], "current": [3, 4]}, "no column for the open-circuit voltage found"),
        ({"soc": [0, 1], "ocv_charge_V": [3, 4]}, "the other is missing; add it as 'ocv_discharge_V'"),
    ],
)
def test_bad_tables(tmp_path, columns, message):
    with pytest.raises(InputError, match=message):
        load_ocv(write(tmp_path / "ocv.csv", **columns))


def test_no_table_at_all(tmp_path):
    with pytest.raises(InputError, match="there is no such file"):
        load_ocv(tmp_path / "none.csv")
    (tmp_path / "text.csv").write_text("soc,ocv_V\n0,3\n1,full\n", encoding="utf-8")
    with pytest.raises(InputError, match="'full' is not a number"):
        load_ocv(tmp_path / "text.csv")


def drive_alone(name: str = "drive", seed: int = 5, soc: float = 1.0, ocv: OcvCurve = NMC_OCV):
    """Discharge and charge at changing currents, no rest of 10 minutes, no low-rate test."""
    rng = np.random.default_rng(seed)
    currents = rng.choice([-4.0, -2.0, -1.0, 0.0, 3.0], 150)
    phases = [(30.0, float(current), 1.0) for current in currents]
    return play(cell(ocv), *steps(phases), soc=soc, std_V=0.001, seed=seed, name=name)


def test_drives_alone_identify_with_a_given_curve(tmp_path):
    path = write(tmp_path / "ocv.csv", soc=GRID, v=NMC_OCV.voltage_V)
    logs = [drive_alone("a", 5, 0.95), drive_alone("b", 6, 0.8)]
    known = {"ocv": path, "initial_soc": {"a": 0.95, "b": 0.8}, "chemistry": "nmc"}
    battery = identify(logs, capacity_Ah=2.0, model="thevenin-2rc", **known)
    soc = np.linspace(0.45, 0.95, 11)
    assert battery.thevenin.ocv.mean_V(soc, 25.0) == pytest.approx(np.asarray(NMC_OCV.mean_V(soc, 25.0)), abs=0.008)
    seen = np.array(battery.thevenin.r0_discharge_ohm)[9:19]
    assert seen == pytest.approx(0.030, rel=0.1)
    assert any("ocv.csv" in note for note in battery.identification.notes)
