import sys
from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError, OhmwardError
from ohmward.optional import MissingPackageError
from ohmward_lab.simulate.electrochemical import ElectrochemicalCell, _run, aged, capacity_Ah, simulate_cell
from ohmward_lab.simulate.profile import steps

LFP = ElectrochemicalCell("Prada2013")
LEAD = ElectrochemicalCell("Sulzer2019", "lead-acid", n_series=6)


def discharged(cell, *phases, ambient_degC=25.0):
    """One second truth of phases (duration_s, current over capacity)."""
    profile = steps([(seconds, rate * cell.nominal_Ah) for seconds, rate in phases], ambient_degC)
    return simulate_cell(cell, profile, np.arange(0.0, profile.time_s[-1], 1.0))


@pytest.fixture(autouse=True)
def _needs_pybamm(request):
    if "missing" not in request.node.name:
        pytest.importorskip("pybamm")


@pytest.mark.slow
def test_the_steps_agree_with_a_solver_of_variable_order_on_a_drive():
    pybamm = pytest.importorskip("pybamm")
    rng = np.random.default_rng(0)
    rates = rng.uniform(-1.2, 0.3, 30)
    profile = steps([(10.0, rate * 2.3) for rate in rates], 5.0)
    found = simulate_cell(LFP, profile, np.arange(0.0, 300.0, 1.0))
    values = LFP.parameters.copy()
    values["Ambient temperature [K]"] = values["Initial temperature [K]"] = 278.15
    values["Current function [A]"] = pybamm.Interpolant(profile.time_s, -profile.current_A, pybamm.t)
    simulation = pybamm.Simulation(
        pybamm.lithium_ion.SPMe(),
        parameter_values=values,
        var_pts={"x_n": 8, "x_s": 5, "x_p": 8, "r_n": 12, "r_p": 12},
        solver=pybamm.IDAKLUSolver(rtol=1e-7, atol=1e-7),
    )
    solution = simulation.solve(t_eval=profile.time_s, t_interp=found.time_s)
    # 1 mV: what the 50 ms of an edge are worth
    expected_V = solution["Terminal voltage [V]"](found.time_s)
    assert found.voltage_V[1:] == pytest.approx(expected_V[1:], abs=1e-3)


def test_charge_is_conserved_and_counted_over_the_capacity():
    truth = discharged(LFP, (60.0, 0.0), (1800.0, -1.0), (600.0, 0.0))
    assert truth.soc[0] == 1.0 and truth.soc[-1] == pytest.approx(1.0 - 0.5 * 2.3 / capacity_Ah(LFP), abs=1e-4)
    assert truth.current_A[0] == 0.0 and truth.current_A[900] == pytest.approx(-2.3)


def test_short_pulses_are_seen():
    truth = discharged(LFP, (600.0, 0.0), (2.0, -2.0), (60.0, 0.0), ambient_degC=0.0)
    assert truth.voltage_V[599] - truth.voltage_V[601] > 0.05


def test_the_cold_cell_resists_more():
    drops = []
    for ambient_degC in (25.0, -10.0):
        truth = discharged(LFP, (600.0, -0.5), (600.0, 0.0), (10.0, -1.0), (5.0, 0.0), ambient_degC=ambient_degC)
        assert truth.temperature_degC[-1] == pytest.approx(ambient_degC, abs=0.1)
        drops.append(truth.voltage_V[1199] - truth.voltage_V[1209])
    assert drops[1] > 1.5 * drops[0]


def test_protection_and_charger_keep_the_limits():
    truth = discharged(LFP, (4500.0, -1.0), (600.0, 0.0), (9000.0, 0.5))
    assert truth.voltage_V.min() > 2.0 - 0.01 and truth.voltage_V.max() < 3.6 + 0.01
    assert -0.02 < truth.soc.min() < 0.05
    # the charger's current fades at its voltage limit, and the cell is full again
    assert truth.current_A[-1] < 0.1 and truth.soc[-1] == pytest.approx(1.0, abs=0.01)


def test_protection_opens_for_a_minute_where_the_equations_give_out():
    def step(y, u):  # counts the charge, and has no solution below zero
        after = ca.if_else(y > u[1] * u[0], y - u[1] * u[0], np.nan)
        return after, ca.vertcat(u[1], after, u[2])

    ca = pytest.importorskip("casadi")
    y, u = ca.SX.sym("y"), ca.SX.sym("u", 3)
    function = ca.Function("step", [y, u], list(step(y, u)))
    demand_A = np.concatenate([np.full(15, 1.0), np.full(95, -0.5)])
    inputs = np.vstack([np.ones(110), demand_A, np.full(110, 298.15)])
    current_A, charge, _ = _run(function, np.array([10.5]), inputs)
    # the step before the failure is the last that counts: nine seconds of discharge, a minute without, then the charge
    assert list(current_A) == [1.0] * 9 + [0.0] * 60 + [-0.5] * 41
    assert charge[-1] == pytest.approx(1.5 + 0.5 * 41)
    with pytest.raises(OhmwardError, match="no solution"):
        _run(function, np.array([-1.0]), inputs)


@pytest.mark.slow
def test_a_set_may_hold_far_more_than_its_label():
    cell = ElectrochemicalCell("Ramadass2004")
    assert 1.7 < capacity_Ah(cell) / cell.nominal_Ah < 1.8


def test_a_cell_that_is_never_empty_is_named(monkeypatch):
    ca = pytest.importorskip("casadi")
    y, u = ca.SX.sym("y", 1), ca.SX.sym("u", 3)
    never = ca.Function("step", [y, u], [y, ca.vertcat(u[1], y, u[2])])
    cell = ElectrochemicalCell("Prada2013", voltage_min_V=2.1)
    monkeypatch.setitem(cell.__dict__, "compiled", (never, lambda kelvin: np.zeros(1)))
    with pytest.raises(OhmwardError, match=r"Prada2013 is not empty after 4 times its 2\.3 Ah: set voltage_min_V"):
        capacity_Ah(cell)


@pytest.mark.slow
def test_an_aged_cell_has_lost_capacity_and_resists_more():
    older = aged(LFP, 0.8, 1.5)
    assert capacity_Ah(older) == pytest.approx(0.8 * capacity_Ah(LFP), rel=2e-3)
    drops = [v[600] - v[602] for v in (discharged(c, (600.0, 0.0), (5.0, -1.0)).voltage_V for c in (LFP, older))]
    assert drops[1] > 1.1 * drops[0]


@pytest.mark.slow
def test_a_lead_acid_battery_is_six_cells_whose_acid_recovers_for_minutes():
    truth = discharged(LEAD, (60.0, 0.0), (3600.0, -0.3), (1800.0, 0.0))
    assert truth.voltage_V[0] == pytest.approx(12.99, abs=0.05)
    assert truth.voltage_V[-1] - truth.voltage_V[3720] > 0.02


@pytest.mark.slow
def test_the_full_model_of_porous_electrodes_is_near_the_single_particle():
    phases = ((60.0, 0.0), (600.0, -0.5), (60.0, 0.0))
    dfn = discharged(ElectrochemicalCell("Ecker2015", "DFN"), *phases)
    spme = discharged(ElectrochemicalCell("Ecker2015"), *phases)
    assert dfn.soc[-1] == pytest.approx(spme.soc[-1], abs=0.005)
    assert dfn.voltage_V == pytest.approx(spme.voltage_V, abs=0.02)


def test_bad_cells_are_refused():
    with pytest.raises(InputError, match=r"parameter_set must be one of .*Prada2013.*, got 'Prada'"):
        capacity_Ah(ElectrochemicalCell("Prada"))
    with pytest.raises(InputError, match=r"'Sulzer2019' does not describe a cell of model 'SPMe': Parameter"):
        capacity_Ah(ElectrochemicalCell("Sulzer2019"))
    with pytest.raises(InputError, match="model must be"):
        ElectrochemicalCell("Prada2013", "SPM2")
    with pytest.raises(InputError, match="lost_lithium must be 0 in a lead-acid cell"):
        replace(LEAD, lost_lithium=0.1)
    with pytest.raises(InputError, match="capacity_ratio"):
        aged(LFP, 1.1)


def test_missing_pybamm_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pybamm", None)
    with pytest.raises(MissingPackageError, match=r"simulated electrochemical cell needs pybamm.*pip install pybamm"):
        capacity_Ah(ElectrochemicalCell("Chen2020"))
