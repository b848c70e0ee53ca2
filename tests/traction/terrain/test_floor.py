from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import qmc

from ohmward.errors import InputError
from ohmward.traction.friction.law import contact
from ohmward.traction.terrain.floor import (
    BETWEEN_SHARE,
    STIFFNESS,
    STIFFNESS_STD,
    Floor,
    Floors,
    like,
    load_floors,
    new_floor,
    save_floors,
    slip_at_force,
    slip_scale,
    slips_of_floors,
)
from traction.terrain.drives import SMOOTH, SOFT
from traction.terrain.slip_rule import slip_belief


@given(st.floats(0.1, 2.0), st.floats(1.0, 50.0), st.floats(0.0, 0.6))
def test_the_law_at_the_slip_of_a_force_gives_that_force(friction, stiffness, slip):
    law = Floor("x", friction, stiffness, 0.0).law
    force = float(law.force_N(contact(1.0, 1.0 - slip, 1.0)))
    found = float(slip_at_force(force, friction, stiffness))
    assert float(law.force_N(contact(1.0, 1.0 - found, 1.0))) == pytest.approx(force, abs=1e-9)


def test_the_slope_at_rest_is_the_stiffness_and_the_slip_is_odd():
    assert slip_at_force(1e-6, 0.8, 8.0) == pytest.approx(1e-6 / 8.0)
    assert slip_at_force(-0.3, 0.8, 8.0) == -slip_at_force(0.3, 0.8, 8.0)


def test_a_wheel_that_the_ground_cannot_hold_spins():
    np.testing.assert_array_equal(slip_at_force(np.array([0.9, -0.9]), 0.8, 8.0), [1.0, -1.0])


def test_a_known_floor_leaves_what_it_does_not_explain():
    sure = replace(SOFT, friction_std=1e-9, stiffness_std=1e-9, slip_std=0.03)
    belief = slip_belief(sure, np.array([0.1, -0.3]), np.zeros(2))
    np.testing.assert_allclose(belief.mean, slip_at_force(np.array([0.1, -0.3]), 1.4, 3.0), rtol=1e-6)
    np.testing.assert_allclose(belief.cov, 0.03**2 * np.eye(2), atol=1e-9)


def test_the_belief_of_an_uncertain_floor_is_that_of_many_floors_drawn_from_it():
    rng = np.random.default_rng(1)
    floor = replace(SOFT, friction_std=0.3, stiffness_std=0.4, correlation=-0.6)
    share = np.array([0.2, 0.3, -0.25])
    logs = rng.multivariate_normal(np.log([floor.friction, floor.stiffness]), floor.log_covariance, 200_000)
    drawn = slip_at_force(share, np.exp(logs[:, :1]), np.exp(logs[:, 1:]))
    belief = slip_belief(floor, share, np.full(3, 1e-6))
    np.testing.assert_allclose(belief.mean, drawn.mean(axis=0), atol=5e-4)
    np.testing.assert_allclose(belief.cov - floor.slip_std**2 * np.eye(3), np.cov(drawn.T), atol=2e-4)


LOPSIDED = replace(SOFT, across=0.5, side=-0.15, speed_power=-0.1, slowest_m_s=0.05, fastest_m_s=0.2)


@pytest.mark.parametrize(
    ("along", "to_left", "speed", "factor"),
    [
        (0.1, 0.0, 0.1, 1.0),  # ahead at the middle speed
        (0.0, 0.1, 0.1, 0.5 * 0.85),
        (0.0, -0.1, 0.1, 0.5 * 1.15),
        (0.2, 0.0, 0.2, 2.0**0.1),
        (3.0, 0.0, 3.0, 2.0**0.1),  # as at the fastest that is known
        (0.03, -0.04, 0.05, np.hypot(0.6, 0.4) * (1 + 0.15 * 0.8) * 0.5**0.1),
    ],
)
def test_the_slip_goes_with_direction_and_speed(along, to_left, speed, factor):
    scale = slip_scale(LOPSIDED, np.array([along]), np.array([to_left]), np.array([speed]))
    assert scale.factor == pytest.approx(factor, rel=1e-4)
    belief, plain = (slip_belief(LOPSIDED, np.array([0.3]), np.zeros(1), *of) for of in ([scale], []))
    assert belief.mean == pytest.approx(factor * plain.mean, rel=1e-4)


def test_a_plain_floor_slips_alike_in_all_directions_and_at_all_speeds():
    scale = slip_scale(SOFT, np.array([0.1, 0.0, -2.0]), np.array([0.3, 0.1, 0.0]), np.array([2.0]))
    np.testing.assert_allclose(scale.factor, 1.0, rtol=1e-12)
    np.testing.assert_array_equal([std.max() for std in scale.std], 0.0)


def test_what_is_unsure_of_direction_and_speed_is_common_to_all_wheels():
    share = np.array([0.2, 0.3, -0.25])
    sure = replace(LOPSIDED, friction_std=1e-9, stiffness_std=1e-9, slip_std=0.0)
    unsure = replace(sure, across_std=0.05, side_std=0.03, speed_power_std=0.1)
    moved = np.array([0.1, 0.05, -0.1]), np.array([0.03, -0.1, 0.02]), np.array([0.15])
    normal = qmc.MultivariateNormalQMC(np.zeros(3), seed=2).random(2**9)
    drawn = [
        slip_belief(f, share, np.zeros(3), slip_scale(f, *moved)).mean
        for f in (
            replace(sure, across=0.5 * np.exp(0.05 * x), side=-0.15 + 0.03 * y, speed_power=-0.1 + 0.1 * z)
            for x, y, z in normal
        )
    ]
    found = slip_belief(unsure, share, np.zeros(3), slip_scale(unsure, *moved)).cov
    np.testing.assert_allclose(found, np.cov(np.array(drawn).T), rtol=0.05, atol=1e-7)


def test_beyond_the_speeds_of_its_drives_a_floor_is_less_sure():
    stds = [
        slip_scale(LOPSIDED, np.array([v]), np.zeros(1), np.array([v])).std[2].item() for v in (0.02, 0.05, 0.2, 0.8)
    ]
    assert stds[1] == stds[2] == 0.0
    assert stds[0] == pytest.approx(0.1 * np.log(0.05 / 0.02))
    assert stds[3] == pytest.approx(0.1 * np.log(4.0))


def test_an_uncertain_force_counts_by_the_slope_of_the_law():
    sure = replace(SOFT, friction_std=1e-9, stiffness_std=1e-9, slip_std=0.0)
    belief = slip_belief(sure, np.array([0.0]), np.array([0.01]))
    assert belief.cov[0, 0] == pytest.approx((0.01 / 3.0) ** 2, rel=0.01)  # the law bends a little within it


def test_a_floor_never_met_is_any_floor_until_one_is_known_and_then_like_it():
    nothing = new_floor()
    assert nothing.stiffness == pytest.approx(STIFFNESS)
    assert nothing.stiffness_std == pytest.approx(STIFFNESS_STD)
    one, two = new_floor([SOFT]), new_floor([SOFT, replace(SOFT, name="other")])
    assert STIFFNESS > one.stiffness > two.stiffness > SOFT.stiffness
    assert nothing.stiffness_std > one.stiffness_std > two.stiffness_std > BETWEEN_SHARE * STIFFNESS_STD


def test_floors_are_kept_in_a_file(tmp_path):
    floors = Floors("robot", (SMOOTH,)).with_floor(SOFT).with_floor(replace(SMOOTH, drives=41))
    save_floors(floors, tmp_path / "floors.toml")
    loaded = load_floors(tmp_path / "floors.toml")
    assert loaded == floors
    assert [(f.name, f.drives) for f in loaded.floor] == [("soft", 40), ("smooth", 41)]


def test_impossible_floors_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"floor.stiffness must be > 0, got -1"):
        replace(SOFT, stiffness=-1.0)
    with pytest.raises(InputError, match=r"floor.correlation must be between -1 and 1, got 1"):
        replace(SOFT, correlation=1.0)
    with pytest.raises(InputError, match=r"floor.across must be > 0 and at most 1, got 1.1"):
        replace(SOFT, across=1.1)
    with pytest.raises(InputError, match=r"floor.side must be between -1 and 1, got -1"):
        replace(SOFT, side=-1.0)
    with pytest.raises(InputError, match=r"floor.speed_power must be between -1 and 1, got nan"):
        replace(SOFT, speed_power=np.nan)
    with pytest.raises(InputError, match=r"floor.slowest_m_s must not be above floor.fastest_m_s, got 0.3 and 0.2"):
        replace(SOFT, slowest_m_s=0.3, fastest_m_s=0.2)
    with pytest.raises(InputError, match="'soft' comes twice"):
        Floors("robot", (SOFT, SOFT))
    (tmp_path / "f.toml").write_text('format = "ohmward-floors/1"\nrobot = "r"\n[[floor]]\nname = "x"\nstifness = 3\n')
    with pytest.raises(InputError, match="did you mean stiffness"):
        load_floors(tmp_path / "f.toml")


def test_floors_are_taken_by_name():
    floors = Floors("a robot", (SMOOTH, SOFT))
    assert floors.named(["soft", "soft"]) == Floors("a robot", (SOFT,))
    with pytest.raises(InputError, match="no floor 'ice' has been learnt; the file has smooth, soft"):
        floors.named(["ice"])


def test_a_floor_like_a_known_one_asks_for_its_forces_and_may_slip_otherwise():
    other = like(SOFT)
    assert (other.rolling, other.roller, other.stiffness) == (SOFT.rolling, SOFT.roller, SOFT.stiffness)
    assert other.stiffness_std > 10 * SOFT.stiffness_std
    known, new = (slip_belief(f, np.array([0.4]), np.array([0.01])) for f in (SOFT, other))
    assert new.cov[0, 0] > 25 * known.cov[0, 0]


def test_a_force_that_was_given_excludes_floors_that_cannot_give_it():
    slippery = replace(SOFT, friction=0.5, friction_std=0.5, correlation=0.0)
    slip, probability = slips_of_floors(slippery, np.array([0.05, 0.6]))
    at_limit = slip[:, 1] == 1.0
    assert probability[at_limit, 0].sum() > 0.5
    assert probability[at_limit, 1].sum() < 1e-5
    np.testing.assert_allclose(probability.sum(axis=0), 1.0)
