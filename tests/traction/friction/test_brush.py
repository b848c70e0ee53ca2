"""The brush theory against its bristles: each one integrated, none of the closed forms used."""

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction.friction.law import Brush, contact

MU, LENGTH, STIFFNESS, LEAD, LOAD = 0.8, 0.06, 3e5, 0.02, 110.0


def bristles(creepage, lead, n=200_000):
    """Force of n bristles, deformed by creepage * (lead + x) until the pressure lets them slide."""
    x = (np.arange(n) + 0.5) * LENGTH / n
    sheared = STIFFNESS * creepage * (lead + x)
    return np.sum(np.minimum(sheared, MU * LOAD / LENGTH)) * LENGTH / n


def law(lead=LEAD):
    return Brush(MU, LENGTH, STIFFNESS, lead)


def force(brush, rim, travel):
    return brush.force_N(contact(rim, travel, LOAD))


@pytest.mark.parametrize("lead", [0.0, 0.005, 0.02, 0.2])
@pytest.mark.parametrize("i", [0.001, 0.05, 0.15, 0.3, 0.7, 0.95])
def test_driving_it_is_the_sum_of_its_bristles(lead, i):
    assert force(law(lead), 1.0, 1.0 - i) == pytest.approx(bristles(i, lead), rel=1e-8)


@pytest.mark.parametrize("lead", [0.0, 0.02])
@pytest.mark.parametrize("skid", [0.001, 0.05, 0.2, 0.6])
def test_braking_it_is_the_sum_of_its_bristles_at_the_skid(lead, skid):
    assert force(law(lead), 1.0 - skid, 1.0) == pytest.approx(-bristles(skid / (1 - skid), lead), rel=1e-8)


def test_all_three_branches_are_met():
    i_c, i_slide = law().critical_creepage(LOAD), MU * LOAD / (STIFFNESS * LENGTH * LEAD)
    assert i_c == pytest.approx(MU * LOAD / (LENGTH * STIFFNESS * (LENGTH + LEAD)))
    assert 0 < i_c < i_slide < 0.7


@pytest.mark.parametrize("lead", [0.0, 0.02])
def test_branches_meet_in_value_and_slope(lead):
    brush = law(lead)
    seams = [brush.critical_creepage(LOAD)] + ([MU * LOAD / (STIFFNESS * LENGTH * lead)] if lead else [])
    for i in seams:
        below, at, above = (force(brush, 1.0, 1.0 - i - d) for d in (-1e-6, 0.0, 1e-6))
        assert above - at == pytest.approx(at - below, abs=1e-6)


def test_the_force_where_bristles_begin_to_slide_is_half_of_all_without_lead():
    brush = law(0.0)
    assert force(brush, 1.0, 1.0 - brush.critical_creepage(LOAD)) == pytest.approx(MU * LOAD / 2)
    assert brush.critical_creepage(LOAD) == pytest.approx(MU * LOAD / (2 * brush.slip_stiffness_N))
    assert brush.slip_stiffness_N == pytest.approx(STIFFNESS * LENGTH**2 / 2)


def test_without_lead_it_is_fialas_law():
    brush = law(0.0)
    for i in (0.1, 0.3, 0.9):
        assert force(brush, 1.0, 1.0 - i) == pytest.approx(
            MU * LOAD * (1 - MU * LOAD / (4 * brush.slip_stiffness_N * i))
        )


def test_a_vanishing_lead_is_the_limit():
    travel = np.linspace(0.0, 1.0, 300)
    np.testing.assert_allclose(force(law(1e-9), 1.0, travel), force(law(0.0), 1.0, travel), atol=1e-4)


def test_it_gives_mu_times_the_load_at_most():
    assert force(law(), 1.0, 0.0) == MU * LOAD
    assert force(law(), 0.0, 1.0) == -MU * LOAD


@pytest.mark.parametrize("field", ["adhesion", "patch_length_m", "tread_stiffness_N_per_m2", "lead_length_m"])
def test_impossible_parameters_are_refused(field):
    good = {"adhesion": MU, "patch_length_m": LENGTH, "tread_stiffness_N_per_m2": STIFFNESS, "lead_length_m": LEAD}
    with pytest.raises(InputError, match=f"brush.{field} must be"):
        Brush(**{**good, field: -1.0})
