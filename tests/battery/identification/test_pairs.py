"""Number of RC pairs: that of the simulated cell, and no time constant beyond what the records show."""

import numpy as np
import pytest

from battery.identification.examples import NMC_OCV, cell, identify, play, pulse_log, steps
from ohmward.battery.chemistries import chemistry_prior
from ohmward.battery.identification.circuit_fit import longest_tau_s
from ohmward.battery.identification.record import make_records


@pytest.mark.parametrize("tau_s", [(60.0,), (20.0, 800.0), (5.0, 60.0, 900.0)])
def test_as_many_pairs_as_the_cell_has(tau_s):
    battery = identify(pulse_log(cell(tau_s=tau_s), count=10, std_V=0.0005), capacity_Ah=2.0, chemistry="nmc")
    assert battery.thevenin.tau_s == pytest.approx(tau_s, rel=0.15)
    assert any(f"RC pairs: {len(tau_s)} chosen by evidence" in note for note in battery.identification.notes)


def test_a_number_that_is_named_is_taken():
    log = pulse_log(cell(tau_s=(60.0,)), count=10, std_V=0.0005)
    battery = identify(log, capacity_Ah=2.0, chemistry="nmc", model="thevenin-2rc")
    assert battery.thevenin.pairs == 2
    assert not any("chosen by evidence" in note for note in battery.identification.notes)


def test_time_constants_stay_within_what_the_records_show():
    """A record of three hours shows nothing that takes four, though the cell has it: no more than usual NMC cells."""
    log = pulse_log(cell(tau_s=(14400.0,)), count=4, rest_s=600.0, std_V=0.0005)
    (record,) = make_records(log, 2.0)
    longest_s = longest_tau_s([record])
    assert longest_s == pytest.approx(0.1 * log.duration_s)
    prior = chemistry_prior("nmc")
    usual_s = prior.slow_tau_s * np.exp(1.96 * prior.slow_tau_log_std)
    battery = identify(log, capacity_Ah=2.0, chemistry="nmc", ocv=NMC_OCV, model="thevenin-1rc")
    assert longest_s < battery.thevenin.tau_s[-1] < 1.1 * usual_s


def test_half_a_long_rest_can_be_shown():
    log = play(cell(), *steps([(60, 0, 10), (600, -2, 10), (7200, 0, 30)]), soc=0.9)
    assert longest_tau_s(make_records(log, 2.0)) == pytest.approx(3600.0, rel=0.01)
