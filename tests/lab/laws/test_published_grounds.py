"""The prior of laws: its moments are those of the tables, and it asks for curves, not for parameters."""

import numpy as np
import pytest
from scipy.stats import loguniform

from ohmward.traction.friction.law import Contact, CoulombCreep, SoftGround, Soil, TractionLaw
from ohmward.traction.friction.terrain import ROADS, SOILS
from ohmward_lab.traction import friction_fit
from ohmward_lab.traction.friction_fit import departures, usual_traction

LOAD_N, SPEED_M_S = 50.0, 0.4
TYPICAL = Contact(0.0, SPEED_M_S, SPEED_M_S, LOAD_N)
MEAN_RESISTANCE = float(loguniform(0.01, 0.4).mean())


def soils():
    """The soils of the table under the two wheels, made here."""
    for name, k_phi, k_c, n, cohesion, phi, lengths in friction_fit.SOILS:
        for length_m in lengths:
            for radius_m in (0.06, 0.165):
                soil = Soil(name, 1e3 * k_phi, 1e3 * k_c, n, 1e3 * cohesion, phi, length_m)
                yield SoftGround(soil, radius_m, 0.05)


def traction_departures(laws):
    return np.array([departures(law, MEAN_RESISTANCE, TYPICAL)[:-1] for law in laws])


def test_roads_and_soils_together_have_the_moments_of_the_prior():
    roads, ground = traction_departures(ROADS.values()), traction_departures(soils())
    assert (roads.mean(axis=0) + ground.mean(axis=0)) / 2 == pytest.approx(np.zeros(4), abs=1e-9)
    W = usual_traction(LOAD_N).whitening
    second = (roads.T @ roads / len(roads) + ground.T @ ground / len(ground)) / 2
    assert second + 0.05**2 * W @ W.T == pytest.approx(np.eye(4), abs=1e-9)


def test_resistances_are_spread_evenly_over_their_decades():
    spread = loguniform(0.01, 0.4)
    of = [departures(CoulombCreep(0.5, 10.0), c, TYPICAL)[-1] for c in (spread.mean(), spread.mean() + spread.std())]
    assert of == pytest.approx([0.0, 1.0], abs=1e-9)


@pytest.mark.parametrize("road", ROADS)
def test_the_same_curve_in_another_form_departs_alike(road):
    law = ROADS[road]
    assert departures(law.at_speed(SPEED_M_S), 0.0, TYPICAL) == pytest.approx(departures(law, 0.0, TYPICAL))


def test_published_laws_are_usual_and_laws_that_no_ground_has_are_not():
    usual: list[TractionLaw] = [*ROADS.values(), *(SoftGround(soil, 0.12, 0.05) for soil in SOILS.values())]
    for law in usual:
        assert np.linalg.norm(departures(law, MEAN_RESISTANCE, TYPICAL)) < 5.0
    for other in (CoulombCreep(5.0, 1e5), CoulombCreep(1e-3, 1e-2)):
        assert np.linalg.norm(departures(other, MEAN_RESISTANCE, TYPICAL)) > 5.0


def test_a_sand_of_both_tables_is_the_same_sand():
    ours = SOILS["LETE sand"]
    k_phi, k_c, n, cohesion, phi = next(row for row in friction_fit.SOILS if row[0] == "LETE sand")[1:6]
    theirs = (1e3 * k_phi, 1e3 * k_c, n, 1e3 * cohesion, phi)
    mine = (ours.frictional_modulus, ours.cohesive_modulus, ours.exponent, ours.cohesion_Pa, ours.friction_deg)
    assert mine == pytest.approx(theirs, rel=0.01)
