from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.traction.friction.law import contact
from ohmward.traction.terrain.file import Floors, load_floors, save_floors
from ohmward.traction.terrain.floor import (
    BETWEEN_SHARE,
    STIFFNESS,
    STIFFNESS_STD,
    Floor,
    like,
    slip_at_force,
    slip_belief,
    slips_of_floors,
    unseen_floor,
)
from traction.terrain.drives import SMOOTH, SOFT


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


def test_an_uncertain_force_counts_by_the_slope_of_the_law():
    sure = replace(SOFT, friction_std=1e-9, stiffness_std=1e-9, slip_std=0.0)
    belief = slip_belief(sure, np.array([0.0]), np.array([0.01]))
    assert belief.cov[0, 0] == pytest.approx((0.01 / 3.0) ** 2, rel=0.01)  # the law bends a little within it


def test_a_floor_never_met_is_any_floor_until_one_is_known_and_then_like_it():
    nothing = unseen_floor()
    assert nothing.stiffness == pytest.approx(STIFFNESS)
    assert nothing.stiffness_std == pytest.approx(STIFFNESS_STD)
    one, two = unseen_floor([SOFT]), unseen_floor([SOFT, replace(SOFT, name="other")])
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
