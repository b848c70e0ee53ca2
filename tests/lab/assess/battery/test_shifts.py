"""Shifts and their sensors: physical, repeatable, and with the errors that the condition names, no others."""

import numpy as np
import pytest

from ohmward_lab.assess.battery import (
    BASE,
    CHEMISTRIES,
    CONDITIONS,
    Condition,
    TrueBattery,
    identified,
    measured,
    shifts,
)
from ohmward_lab.assess.draws import generator, signs
from ohmward_lab.simulate.cells import BATTERIES

EXACT = BASE._replace(offset_C=0.0, gain=0.0, current_noise_C=0.0, voltage_noise_V=0.0, voltage_step_V=1e-9)


@pytest.mark.parametrize("chemistry", CHEMISTRIES)
def test_a_shift_stays_within_its_battery(chemistry):
    found, battery = shifts(chemistry, TrueBattery(), 3, 1), BATTERIES[chemistry]
    assert found.soc.shape == (28_800, 3) and (found.soc >= 0.0).all() and (found.soc <= 1.0).all()
    assert found.soc.min() < 0.5 < 0.8 <= found.soc[0].min()
    assert (
        found.voltage_V.min() >= battery.voltage_min_V - 1e-6 and found.voltage_V.max() <= battery.voltage_max_V + 1e-6
    )


def test_charge_is_the_integral_of_the_current():
    found = shifts("nca", TrueBattery(), 2, 1)
    mean_A = 0.5 * (found.current_A[1:] + found.current_A[:-1])
    moved = np.cumsum(mean_A, axis=0) / 3600.0 / BATTERIES["nca"].circuit.capacity_Ah
    np.testing.assert_allclose(found.soc[1:] - found.soc[0], moved, atol=1e-6)


def test_a_condition_of_the_battery_is_in_its_truth():
    base, smaller = shifts("nca", TrueBattery(), 2, 1), shifts("nca", TrueBattery(capacity_ratio=0.9), 2, 1)
    fall = [found.soc[0] - found.soc[7200] for found in (base, smaller)]
    np.testing.assert_allclose(fall[1], fall[0] / 0.9, rtol=1e-6)
    cold = shifts("nca", TrueBattery(-10.0), 2, 1)
    assert cold.temperature_degC[0].max() == -10.0 and cold.voltage_V[600].max() < base.voltage_V[600].min()


def test_sensors_have_the_errors_of_the_condition():
    truth = shifts("lfp", TrueBattery(), 4, 1)
    plain, soc = measured("lfp", EXACT, 4, 1)
    np.testing.assert_allclose(plain.current_A, truth.current_A)
    np.testing.assert_allclose(plain.voltage_V, truth.voltage_V, atol=1e-8)
    np.testing.assert_array_equal(soc, truth.soc)
    wrong, _ = measured("lfp", EXACT._replace(offset_C=0.05), 4, 1)
    np.testing.assert_allclose(wrong.current_A - truth.current_A, np.tile(0.6 * signs(4), (28_800, 1)))
    late, _ = measured("lfp", EXACT._replace(delay_s=5.0), 4, 1)
    np.testing.assert_allclose(late.voltage_V[5:], truth.voltage_V[:-5], atol=1e-8)
    slow, _ = measured("lfp", EXACT._replace(interval_s=60.0), 4, 1)
    np.testing.assert_allclose(slow.voltage_V, truth.voltage_V[::60], atol=1e-8)
    assert slow.dt_s[0] == 0.0 and set(slow.dt_s[1:]) == {60.0}
    lost, _ = measured("lfp", EXACT._replace(missing=0.3), 4, 1)
    assert np.isnan(lost.current_A).mean() == pytest.approx(0.3, abs=0.01)
    assert np.isnan(lost.voltage_V).mean() == pytest.approx(0.3, abs=0.01)


def test_names_are_those_of_one_condition_each():
    assert len({condition.name for condition in CONDITIONS}) == len(CONDITIONS) >= 25
    assert Condition("start", "unknown").name == "start: unknown"


def test_random_numbers_depend_on_the_words_alone():
    assert generator("shift", "lfp", 1).random() == generator("shift", "lfp", 1).random()
    assert generator("shift", "lfp", 1).random() != generator("shift", "lfp", 2).random()


def test_the_battery_file_is_that_of_the_battery():
    assert identified("nca").capacity_Ah == BATTERIES["nca"].circuit.capacity_Ah
