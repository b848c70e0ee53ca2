"""Battery files of format 1, one of which `ohmward identify` wrote from a pulse test, with its lists thinned."""

from dataclasses import replace

import pytest

from ohmward.battery.chemistries import AGED_CAPACITY_STD, AGED_RESISTANCE_STD, chemistry_prior, start_noise
from ohmward.battery.file import BATTERY_FILE
from ohmward.battery.models.sensor import CurrentSensor
from ohmward.battery.soc.band_forecast import forecast
from ohmward.errors import InputError

OLD = """\
# A battery as ohmward knows it. Edit what you know better; every key carries its unit.
# Currents > 0 charge. SoC runs from 0 (empty) to 1 (full). Voltages and resistances are those of the whole pack.
# A list along SoC stands on a uniform grid from SoC 0 to SoC 1, ends included. *_std are standard deviations.

format = "ohmward-battery/1"
name = "simulated lfp pulse test"
capacity_Ah = 12
chemistry = "lfp"
n_series = 4
voltage_min_V = 10.9777
voltage_max_V = 13.7947
not_identified = [
    "hysteresis: needs a low-rate discharge and a low-rate charge; taken as none",
]

[thevenin]
capacity_Ah = 12
r0_discharge_ohm = [0.0510045, 0.0401917, 0.0443432]
r0_charge_ohm = [0.0506785, 0.0403516, 0.0436556]
r_ohm = [
    [0.0169851, 0.0116754, 0.0126049],
    [0.0229146, 0.0143305, 0.0139562],
]
tau_s = [48.1191, 1004.23]
hysteresis_rate = 20.0
coulombic_efficiency = 1.0
activation_K = 0.0
reference_degC = 20.3125

[thevenin.ocv]
voltage_V = [
    11.0862, 12.8827, 12.939, 13.0362, 13.08, 13.0919, 13.1067, 13.2252, 13.2782, 13.2947,
    13.7786,
]
hysteresis_V = [
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    0.0,
]
temperature_V_per_K = [
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    0.0,
]
reference_degC = 20.3125

[noise]
voltage_std_V = 0.00687856
model_std_V = [0.0275142, 0.0275142, 0.0275142]
model_soc_length = 0.1
overpotential_share = 0.15
soc_axis_std = 0.01
correlation_s = 300.0
current_std_A = 0.024
current_offset_std_A = 0.3
current_offset_walk_A = 0.012
capacity_std = 0.01
capacity_walk = 0.01
resistance_std = 0.05
resistance_walk = 0.05

[rc_noise]
voltage_std_V = 0.00431285
current_std_A = 0.05
current_offset_std_A = 0.05
current_offset_walk_A = 0.002

[identification]
capacity_given_Ah = 12
capacity_measured_Ah = 0.0
notes = [
    "info: 'simulated lfp pulse test': SoC starts at 1.000 and runs from -0.000 to 1.000 (rest at 13.79 V, ± 1.0%)",
    "info: 47 edges show R_0 = 41.1 ± 1.5 mohm in discharge",
]

[[identification.logs]]
log = "simulated lfp pulse test"
test = "pulses"
soc_min = -0.000484757
soc_max = 1.0
residual_rms_V = 0.00628456
residual_max_V = 0.0927865
"""


def test_an_old_file_loads_and_keeps_what_it_says():
    battery = BATTERY_FILE.parse(OLD)
    assert battery.name == "simulated lfp pulse test"
    assert battery.thevenin is not None
    assert battery.thevenin.tau_s == (48.1191, 1004.23)
    assert battery.noise.overpotential_share == 0.15
    assert battery.sensor == CurrentSensor(noise_std_A=0.024, offset_std_A=0.3, offset_walk_A=0.012)


def test_what_it_lacks_comes_from_the_chemistry_and_is_said():
    battery, prior = BATTERY_FILE.parse(OLD), chemistry_prior("lfp")
    assert battery.thevenin is not None
    assert battery.thevenin.activation_K == prior.activation_K.mean
    assert battery.thevenin.pair_activation_K == prior.pair_activation_K.mean
    assert battery.noise.activation_std_K == prior.activation_std_K
    assert battery.thevenin.empty_activation_K == prior.empty_activation_K.mean
    assert battery.noise.empty_activation_std_K == prior.empty_activation_K.std
    assert battery.noise.ocv_std_V_per_K == pytest.approx(prior.ocv_std_V_per_K * 13.1 / 3.7, rel=0.03)
    assert battery.noise.model_std_V[0] == pytest.approx((0.0275142**2 + (0.01 * 13.1 / 3.7) ** 2) ** 0.5, rel=0.03)
    assert battery.noise.capacity_std == AGED_CAPACITY_STD
    assert battery.noise.resistance_std == AGED_RESISTANCE_STD
    said = " ".join(battery.not_identified)
    for word in ("hysteresis: needs", "activation: this file", "open-circuit voltage against", "[sensor]", "lfp cells"):
        assert word in said


def test_an_activation_that_was_tested_stays():
    text = OLD.replace("activation_K = 0.0", "activation_K = 2235.0")
    battery = BATTERY_FILE.parse(text)
    assert battery.thevenin is not None
    assert battery.thevenin.activation_K == 2235.0
    assert battery.thevenin.pair_activation_K is None
    assert battery.noise.activation_std_K == chemistry_prior("lfp").activation_std_K


def test_without_a_chemistry_the_doubts_are_wider():
    battery = BATTERY_FILE.parse(OLD.replace('chemistry = "lfp"\n', ""))
    assert battery.noise.activation_std_K > chemistry_prior("lfp").activation_std_K
    assert "name the chemistry" in " ".join(battery.not_identified)


def test_saved_again_it_is_a_file_of_today():
    battery = BATTERY_FILE.parse(OLD)
    text = BATTERY_FILE.dump(battery)
    assert 'format = "ohmward-battery/3"' in text
    assert BATTERY_FILE.dump(BATTERY_FILE.parse(text)) == text


@pytest.mark.parametrize(
    ("was", "becomes", "says"),
    [
        ("tau_s = [48.1191, 1004.23]", 'tau_s = "long"', "tau_s"),
        ('chemistry = "lfp"', "chemistry = 3", "chemistry"),
        ("current_std_A = 0.024", "current_std_A = -1", "noise_std_A"),
        ("not_identified = [", "not_identified = 1\nlost = [", "lost|not_identified"),
        ("current_std_A = 0.024", "current_sdt_A = 0.024", "current_sdt_A"),
    ],
)
def test_what_is_wrong_in_an_old_file_is_named(was, becomes, says):
    assert was in OLD
    with pytest.raises(InputError, match=says):
        BATTERY_FILE.parse(OLD.replace(was, becomes, 1))


def test_noise_that_is_no_table_is_named():
    start, end = OLD.index("[noise]"), OLD.index("[rc_noise]")
    with pytest.raises(InputError, match="noise must be a table"):
        BATTERY_FILE.parse(OLD[:start].replace("[thevenin]", "noise = 3\n\n[thevenin]", 1) + OLD[end:])


def test_in_the_cold_an_old_file_is_no_longer_sure():
    """Its band is wider than that of the file taken as it stands, though not at the temperature of the test."""
    loaded = BATTERY_FILE.parse(OLD)
    sure = replace(loaded, noise=replace(loaded.noise, activation_std_K=0.0, ocv_std_V_per_K=0.0))
    warm, cold = forecast(loaded, [20.3, -10.0])
    sure_warm, sure_cold = forecast(sure, [20.3, -10.0])
    assert warm.known_start == pytest.approx(sure_warm.known_start, rel=0.02)
    assert cold.known_start > 1.1 * sure_cold.known_start


def test_start_values_of_format_1_are_doubted_as_much_as_those_of_today():
    label = OLD[: OLD.index("[identification]")].replace("capacity_std = 0.01", "capacity_std = 0.05", 1)
    battery, today = BATTERY_FILE.parse(label), start_noise("lfp", 4)
    assert battery.noise.capacity_std == today.capacity_std
    assert battery.noise.resistance_std == today.resistance_std
    assert battery.noise.model_std_V == today.model_std_V
    assert "doubted as much as cells with one label differ" in battery.not_identified[-1]
