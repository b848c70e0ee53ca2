"""Bent drop over the ohmic resistance: found without noise where it is, left out where it is not."""

from dataclasses import replace

import numpy as np
import pytest

from battery.identification.examples import cell, pulse_log
from battery.identification.test_circuit import problem_of
from ohmward.battery.identification.circuit_fit import circuit_of, fit_circuit
from ohmward.battery.identification.circuit_solve import Rates, block, solve
from ohmward.battery.identification.identify import cells_transfer_V, try_transfer

TRANSFER_V = cells_transfer_V(25.0, 1)
#: Half a volt at 1 C, as a lead-acid cell with little charge left: ten times the bend.
BENT = replace(cell(), r0_discharge_ohm=(0.25,) * 21, r0_charge_ohm=(0.25,) * 21, transfer_V=TRANSFER_V)


@pytest.fixture(scope="module")
def problem():
    return problem_of(pulse_log(BENT, count=5, rest_s=1800.0))


def test_the_bend_of_a_cell_is_that_of_physics():
    """2RT/F = 51.4 mV at 25 degC; in series they add up, and grow with the absolute temperature."""
    assert cells_transfer_V(25.0, 1) == pytest.approx(0.05139, rel=1e-4)
    assert cells_transfer_V(25.0, 6) == pytest.approx(6 * cells_transfer_V(25.0, 1), rel=1e-12)
    assert cells_transfer_V(-10.0, 1) / cells_transfer_V(25.0, 1) == pytest.approx(263.15 / 298.15, rel=1e-12)


def test_the_resistance_to_a_small_current_is_found_from_large_ones(problem):
    found = solve(problem, Rates(BENT.tau_s, BENT.hysteresis_rate, transfer_V=TRANSFER_V))
    for j, ohm in enumerate((0.25, 0.25, 0.010, 0.025)):
        assert found.x[block(j)][10] == pytest.approx(ohm, rel=0.07)
    assert np.nanmax(np.abs(found.residual_V[0])) < 5e-3


def test_a_bent_drop_is_taken_where_the_log_shows_it(problem):
    straight = fit_circuit(problem, 2)
    fit, note = try_transfer(straight, 1)
    assert fit.solution.rows.misfit < 0.1 * straight.solution.rows.misfit
    assert note.text.endswith("and is taken")
    model = circuit_of(fit.solution, 1.0)
    assert model.transfer_V == TRANSFER_V
    assert model.r0_discharge_ohm[10] == pytest.approx(0.25, rel=0.05)


def test_a_straight_drop_stays_straight():
    """100 mV at 1 C, twice the bend, but in proportion to the current."""
    ohmic = replace(BENT, r0_discharge_ohm=(0.05,) * 21, r0_charge_ohm=(0.05,) * 21, transfer_V=None)
    problem = problem_of(pulse_log(ohmic, count=5, rest_s=1800.0, std_V=0.001))
    straight = fit_circuit(problem, 2)
    fit, note = try_transfer(straight, 1)
    assert fit is straight
    assert "ohmic drop: straight" in note.text
