"""Logs of simulated electrochemical cells: what their sensors show, and where their tests end."""

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward_lab.simulate import electrochemical
from ohmward_lab.simulate.electrochemical import CellTruth, ElectrochemicalCell, record_cell, usual_model

RAMP_S = np.arange(0.0, 3600.0)


def truth(voltage_V):
    return CellTruth(100.0 + RAMP_S, np.full(3600, -1.0), voltage_V, np.full(3600, 21.03), np.linspace(1.0, 0.9, 3600))


@pytest.fixture
def asked(monkeypatch):
    """Loads that were asked for, of a cell of 2 Ah whose voltage falls from 3.6 to 1.9 V; PyBaMM is not needed."""
    loads = []

    def simulate_cell(cell, profile, time_s):
        loads.append((profile, time_s))
        voltage_V = cell.n_series * np.linspace(3.6, 1.9, time_s.size)
        return CellTruth(time_s, np.interp(time_s, *profile[:2]), voltage_V, 0.0 * time_s, time_s / time_s[-1])

    monkeypatch.setattr(electrochemical, "simulate_cell", simulate_cell)
    monkeypatch.setattr(electrochemical, "capacity_Ah", lambda cell: 2.0)
    return loads


def test_sensors_show_their_errors_and_their_steps():
    sensors = electrochemical.usual_sensors(4.6, n_series=2, offset=0.1 / 4.6, gain=0.02, voltage_step_V=0.01)
    log = electrochemical.log_of(truth(np.full(3600, 7.4)), sensors, np.random.default_rng(1), "cheap")
    assert log.time_s[0] == 0.0
    assert np.mean(log.current_A) == pytest.approx(-1.02 + 0.1, abs=1e-3)
    assert np.std(log.current_A) == pytest.approx(0.002 * 4.6, rel=0.05)
    assert np.allclose(log.voltage_V / 0.02, np.round(log.voltage_V / 0.02))
    assert log.temperature_degC is not None and np.mean(log.temperature_degC) == pytest.approx(21.03, abs=0.01)
    assert list(log.extra["soc_true"]) == list(truth(RAMP_S).soc)


@pytest.mark.parametrize("record", electrochemical.RECORDS)
def test_each_record_is_of_the_cell_from_full(record, asked):
    log = record_cell(ElectrochemicalCell("Prada2013"), record, ambient_degC=5.0)
    profile, time_s = asked[0]
    assert len(log) == time_s.size and profile.current_A[0] == 0.0
    assert set(profile.ambient_degC) == {5.0}
    assert {"pulse-test": -2.0, "low-rate-test": -0.1}.get(record, profile.current_A.min()) == profile.current_A.min()
    assert "simulated" in log.name and "Prada2013, SPMe, 2 Ah" in str(log.notes[0])


def test_the_same_seed_gives_the_same_day_and_another_seed_another(asked):
    first, again, other = (record_cell(ElectrochemicalCell("Prada2013"), "day", seed=s) for s in (1, 1, 2))
    assert np.array_equal(first.current_A, again.current_A)
    assert first.current_A[:3000].std() != other.current_A[:3000].std()


def test_an_aged_cell_is_loaded_as_the_new_one_was(asked):
    record_cell(ElectrochemicalCell("Prada2013"), "pulse-test", new_Ah=2.5)
    assert asked[0][0].current_A.min() == -2.5


def test_a_test_of_lead_acid_ends_at_its_cut_off():
    lead = ElectrochemicalCell("Sulzer2019", "lead-acid", n_series=6, voltage_min_V=1.75, voltage_max_V=2.42)
    falling = truth(np.linspace(12.5, 10.0, 3600))
    pytest.importorskip("pybamm")
    cut = electrochemical.until_cut_off(falling, lead)
    assert 10.5 < cut.voltage_V[-1] <= 10.53 and len(cut.soc) == len(cut.voltage_V)
    assert electrochemical.until_cut_off(falling, ElectrochemicalCell("Prada2013")) is falling


def test_the_usual_model_is_that_of_the_chemistry():
    assert usual_model("Sulzer2019") == "lead-acid" and usual_model("Chen2020") == "SPMe"


def test_an_unknown_record_is_refused():
    with pytest.raises(InputError, match="record must be one of pulse-test, low-rate-test, day, got 'hppc'"):
        record_cell(ElectrochemicalCell("Prada2013"), "hppc", new_Ah=2.0)
