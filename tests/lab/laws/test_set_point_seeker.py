"""The set-point against the peak and the best slip of laws that are known."""

import math
from typing import Any

import numpy as np
import pytest

from laws.examples import best_slip_ratio, driving_force
from ohmward.errors import InputError
from ohmward.traction.friction.law import CoulombCreep, WardIagnemma
from ohmward.traction.friction.terrain import ROADS
from ohmward_lab.traction.set_points import SetPointSeeker

LOAD_N, SPEED, DT = 100.0, 0.5, 0.01
LAWS: dict[str, Any] = {
    "dry asphalt": ROADS["dry asphalt road"],
    "wet asphalt": ROADS["wet asphalt road"],
    "no peak": WardIagnemma(0.5, 8.0),
    "plateau": CoulombCreep(0.5, 6.25),
}


def seek(seeker, law, start, duration_s=25.0, follows=0.5, noise=0.0):
    """The last set-point; the slip follows it by a share in each step."""
    rng = np.random.default_rng(1)
    state, slip, wanted = seeker.init(start), start, start
    for _ in range(round(duration_s / DT)):
        slip += follows * (wanted - slip)
        mu = driving_force(law, slip, LOAD_N, SPEED) / LOAD_N + noise * rng.standard_normal()
        state, found = seeker.step(state, slip, mu, DT)
        wanted = found.slip_ratio
    return found


@pytest.mark.parametrize("start", [0.03, 0.3])
@pytest.mark.parametrize("name", ["dry asphalt", "wet asphalt"])
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_the_peak_is_found_from_both_sides(name, start, noise):
    law = LAWS[name]
    found = seek(SetPointSeeker(), law, start, noise=noise)
    assert found.identified
    assert driving_force(law, found.centre, LOAD_N, SPEED) >= 0.995 * law.peak_adhesion * LOAD_N
    assert found.centre == pytest.approx(law.peak_slip_ratio, abs=0.02)


def test_on_a_plateau_all_of_the_force_is_found():
    found = seek(SetPointSeeker(), LAWS["plateau"], 0.03)
    assert driving_force(LAWS["plateau"], found.centre, LOAD_N, SPEED) >= 0.99 * 50.0


@pytest.mark.parametrize("start", [0.03, 0.3])
@pytest.mark.parametrize("name", LAWS)
def test_the_slip_of_least_energy_is_found(name, start):
    best = best_slip_ratio(LAWS[name], LOAD_N, 5.0, SPEED)
    found = seek(SetPointSeeker("energy", resistance_coefficient=0.05), LAWS[name], start)
    assert found.identified
    assert found.centre == pytest.approx(best, abs=0.01)


def test_without_excitation_nothing_is_identified_and_nothing_moves():
    for seeker, follows in ((SetPointSeeker(dither=0.0), 0.5), (SetPointSeeker(), 0.0)):
        found = seek(seeker, LAWS["dry asphalt"], 0.05, duration_s=10.0, follows=follows)
        assert not found.identified
        assert math.isnan(found.slope)
        assert found.centre == 0.05


def test_a_slip_that_is_no_number_changes_nothing():
    seeker = SetPointSeeker()
    state = seeker.init(0.1)
    state, _ = seeker.step(state, 0.1, 0.5, DT)
    after, found = seeker.step(state, math.nan, 0.5, DT)
    assert after == state
    assert not found.identified


def test_a_swing_from_afar_is_not_learned_from():
    seeker = SetPointSeeker()
    state = seeker.init(0.3)
    for slip in np.linspace(0.0, 0.26, 200):
        state, found = seeker.step(state, slip, 3.0 * slip, DT)
    assert state == seeker.init(0.3)
    assert not found.identified


def test_the_slope_is_the_regression():
    seeker = SetPointSeeker(window_s=1e9, pace_per_s=1e-9, reach=0.1)
    rng = np.random.default_rng(4)
    slips = rng.uniform(0.05, 0.15, 300)
    mus = 0.1 + 3.0 * slips + 0.01 * rng.standard_normal(300)
    state = seeker.init(0.1)
    for slip, mu in zip(slips, mus, strict=True):
        state, found = seeker.step(state, slip, mu, DT)
    assert found.slope == pytest.approx(np.polyfit(slips, mus, 1)[0], rel=1e-6)


def test_the_set_point_stays_in_its_range_and_keeps_its_pace():
    seeker = SetPointSeeker(highest=0.08)
    assert seek(seeker, LAWS["dry asphalt"], 0.03).centre == 0.08
    assert seek(seeker, LAWS["dry asphalt"], 0.03, duration_s=1.5).centre <= 0.03 + 0.52 * 0.05


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: SetPointSeeker("speed"), "objective must be one of"),
        (lambda: SetPointSeeker("energy"), "resistance_coefficient must be > 0"),
        (lambda: SetPointSeeker(lowest=0.3, highest=0.2), "highest must be between 0.3"),
    ],
)
def test_bad_settings_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
