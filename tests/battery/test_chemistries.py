from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.chemistries import CHEMISTRIES, chemistry_name, generic_battery, start_model, start_noise
from ohmward.battery.file import BATTERY_FILE, load_battery, save_battery
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.errors import InputError
from ohmward.logs import Log
from ohmward_lab.simulate.voltage import simulate_voltage


@pytest.mark.parametrize("name", CHEMISTRIES)
def test_every_chemistry_makes_a_battery_that_survives_its_file(name):
    battery = generic_battery(name, 12.0, 4)
    again = BATTERY_FILE.parse(BATTERY_FILE.dump(battery))
    assert again.thevenin is not None and again.thevenin.capacity_Ah == 12.0
    assert (
        again.voltage_min_V < again.thevenin.ocv.voltage_V[0] < again.thevenin.ocv.voltage_V[-1] < again.voltage_max_V
    )


@pytest.mark.parametrize("name", CHEMISTRIES)
def test_resistance_falls_with_capacity_and_grows_with_cells(name):
    small, large = start_model(name, 2.0), start_model(name, 20.0, 3)
    assert np.array(large.r_ohm) == pytest.approx(3 / 10 * np.array(small.r_ohm))
    assert large.ocv.voltage_V[-1] == pytest.approx(3 * small.ocv.voltage_V[-1])


@pytest.mark.usefixtures("in_python")
@pytest.mark.parametrize("name", CHEMISTRIES)
def test_a_label_doubts_where_its_charger_stops(name):
    noise, known = start_noise(name), CHEMISTRIES[name]
    lower_V = known.ocv().mean_V(1.0 - noise.full_soc_std, 25.0)
    assert lower_V == pytest.approx(known.ocv_V[-1] * (1.0 if known.gases else 0.988), abs=0.006)
    assert start_noise(name, ocv_known=True).full_soc_std == 0.0


@pytest.mark.parametrize("name", CHEMISTRIES)
def test_the_first_voltage_is_read_back(name):
    """At rest in the middle of the curve the filter starts where the curve says, within its own sigma."""
    model, noise = start_model(name, 2.0), start_noise()
    estimate = SocEstimator(TheveninFilter(model, noise)).update(0.0, 0.0, float(model.ocv.mean_V(0.5, 25.0)))
    assert abs(estimate.soc - 0.5) < 2 * estimate.soc_std


@pytest.mark.parametrize("name", CHEMISTRIES)
def test_the_rc_filter_of_a_generic_battery_covers_a_cell_of_its_chemistry(name):
    """A cell with resistances a third higher and a curve 10 mV off, two hours from a start that nobody knows."""
    battery = generic_battery(name, 2.0)
    model = battery.thevenin
    assert model is not None
    ocv = replace(model.ocv, voltage_V=tuple(v + 0.01 for v in model.ocv.voltage_V))
    r0_ohm = tuple(1.3 * r for r in model.r0_discharge_ohm)
    r_ohm = tuple(tuple(1.3 * r for r in row) for row in model.r_ohm)
    cell = replace(model, ocv=ocv, r0_discharge_ohm=r0_ohm, r0_charge_ohm=r0_ohm, r_ohm=r_ohm)
    rng, time_s = np.random.default_rng(4), np.arange(7200.0)
    current_A = np.repeat(rng.uniform(-1.6, 0.6, 120), 60)
    log = Log("drive", time_s, current_A, np.zeros(7200), np.full(7200, 25.0))
    truth = simulate_voltage(cell, log, 0.85)
    run = SocEstimator(battery, filter="rc").run(replace(log, voltage_V=truth.voltage_V))
    error = np.abs(run.soc - truth.soc)
    assert np.mean(error < 1.96 * run.soc_std) > 0.9
    assert error[3600:].max() < (0.25 if name in ("lfp", "sodium-ion", "nimh") else 0.12)


@pytest.mark.parametrize(
    ("name", "known"),
    [("LFP", "lfp"), ("LiFePO4", "lfp"), ("AGM", "lead-acid"), ("Li-ion", "nmc"), ("Lead Acid", "lead-acid"), ("", "")],
)
def test_a_chemistry_has_the_names_that_labels_have(name, known, tmp_path):
    assert chemistry_name(name) == known
    save_battery(replace(generic_battery(known or "lfp", 2.0), chemistry=name), tmp_path / "b.toml")
    assert load_battery(tmp_path / "b.toml").chemistry == known


def test_an_unknown_chemistry_is_refused_with_the_known_ones(tmp_path):
    save_battery(replace(generic_battery("lfp", 2.0), chemistry="unobtainium"), tmp_path / "b.toml")
    with pytest.raises(InputError, match=r"b.toml: chemistry must be one of nmc, .*, got 'unobtainium'"):
        load_battery(tmp_path / "b.toml")


#: Open-circuit voltage that Safari and Delacourt 2011 measured of the electrodes of an A123 cell, and Afshar of another
#: LFP cathode against the graphite of an 18650 cell (About:Energy), at these SoC; not rounded into the curve here.
PUBLISHED_SOC = (0.1, 0.3, 0.5, 0.7, 0.9)
PUBLISHED_LFP = ((3.199, 3.283, 3.308, 3.324, 3.344), (3.189, 3.268, 3.279, 3.306, 3.322))


@pytest.mark.parametrize("published", PUBLISHED_LFP)
def test_published_cells_lie_within_two_sigma_of_the_label(published):
    curve, noise = start_model("lfp", 2.0).ocv, start_noise("lfp")
    for soc, voltage_V in zip(PUBLISHED_SOC, published, strict=True):
        assert abs(voltage_V - curve.mean_V(soc, 25.0)) < 2 * noise.model_std_at(soc)


#: Voltage at C/50 in the model of Chayambuka et al. 2022, a sodium-ion cell of another positive electrode.
CHAYAMBUKA = {0.1: 2.851, 0.3: 3.418, 0.5: 3.843, 0.7: 4.043, 0.9: 4.083}


def test_the_label_of_a_sodium_ion_cell_covers_one_of_another_kind():
    curve, noise = start_model("sodium-ion", 2.0).ocv, start_noise("sodium-ion")
    for soc, voltage_V in CHAYAMBUKA.items():
        assert abs(voltage_V - curve.mean_V(soc, 25.0)) < 2 * noise.model_std_at(soc)


@pytest.mark.parametrize("name", [name for name in CHEMISTRIES if name != "lead-acid"])
def test_a_label_doubts_the_curve_most_where_it_is_nearly_empty(name):
    model_std_V = start_noise(name).model_std_V
    assert len(model_std_V) == 11
    assert np.all(np.diff(model_std_V[:3]) < 0)
    assert start_noise(name, 4).model_std_V == tuple(4 * std_V for std_V in model_std_V)


@pytest.mark.parametrize("offset_V", [-0.03, 0.055])
def test_the_label_covers_an_lfp_cell_with_another_plateau(offset_V):
    """Five hours of drive and charge from a right start, on a cell whose curve lies beside the label's."""
    battery = generic_battery("lfp", 2.0)
    model = battery.thevenin
    assert model is not None
    cell = replace(model, ocv=replace(model.ocv, voltage_V=tuple(v + offset_V for v in model.ocv.voltage_V)))
    rng, time_s = np.random.default_rng(5), np.arange(18000.0)
    current_A = np.repeat(rng.uniform(-1.2, 0.4, 300), 60)
    current_A[9000:12000] = 1.0
    log = Log("drive", time_s, current_A, np.zeros(18000), np.full(18000, 25.0))
    truth = simulate_voltage(cell, log, 0.9)
    run = SocEstimator(battery, 0.9).run(replace(log, voltage_V=truth.voltage_V))
    assert np.mean(np.abs(run.soc - truth.soc) < 1.96 * run.soc_std) > 0.9


def test_a_known_curve_takes_the_place_of_the_chemistrys():
    ocv = OcvCurve((3.1, 4.1))
    assert start_model("nmc", 2.0, 2, ocv).ocv.voltage_V == (6.2, 8.2)
    assert start_noise(ocv_known=True).model_std_V[0] < start_noise().model_std_V[0]


def test_refusals():
    with pytest.raises(InputError, match=r"chemistry must be one of nmc, nca, lipo, lfp, .*, got 'nicd'"):
        start_model("nicd", 2.0)
    with pytest.raises(InputError, match="capacity_Ah must be > 0, got 0"):
        generic_battery("lfp", 0.0)


def test_lead_acid_gases_above_its_full_voltage_and_lithium_never():
    pack = start_model("lead-acid", 12.0, 6)
    assert pack.gassing_V == pytest.approx(1.03 * pack.ocv.voltage_V[-1])
    assert pack.gassing_V == pytest.approx(6 * 2.23, abs=0.01)
    assert start_model("lfp", 12.0, 4).gassing_V is None


def test_a_battery_prints_as_one_line():
    battery = generic_battery("lfp", 12.0, 4, "desk")
    volts = f"{battery.voltage_min_V:.4g} to {battery.voltage_max_V:.4g} V"
    assert repr(battery) == f"Battery('desk', 4 lfp in series, 12 Ah, {volts})"
