from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from ohmward.errors import InputError
from ohmward.traction import RLMA
from ohmward.traction.terrain.floor import drag_columns, static_loads
from ohmward.traction.terrain.recognition import (
    PERSISTENT_SHARE,
    RIGHT_SHARE,
    SETTLING_S,
    FloorForces,
    Recognition,
    RecognitionState,
)
from traction.terrain.drives import OMNI, SMOOTH, SOFT, omni_drive, on_floors

MOVING = slice(60, None)


@pytest.mark.parametrize("under", [(0, 0, 0), (1, 1, 1), (0, 1, 0), (1, 0, 1)])
def test_the_floor_under_each_wheel_is_found(under):
    floors = [(SMOOTH, SOFT)[k] for k in under]
    track = on_floors((SMOOTH, SOFT)).run(omni_drive(floors, 20.0, rng=np.random.default_rng(4)).log)
    found = track.floor_probability[MOVING].mean(axis=0).argmax(axis=1)
    np.testing.assert_array_equal(found, under)
    np.testing.assert_allclose(track.floor_probability.sum(axis=-1), 1.0, rtol=1e-12)


def test_a_floor_that_asks_for_other_forces_than_all_known_ones_was_never_met():
    carpet = replace(SOFT, rolling=0.3, roller=0.5)
    track = on_floors((SMOOTH,)).run(omni_drive([carpet] * 3, 20.0, rng=np.random.default_rng(5)).log)
    assert track.floor_probability[MOVING, :, -1].min() > 0.99


def test_before_anything_is_measured_known_floors_are_alike_and_a_new_one_is_as_likely_as_each():
    r = Recognition(OMNI, (SMOOTH, SOFT))
    share = r.by_name(r.by_wheel(r.init().combinations))
    np.testing.assert_allclose(share, 1 / 3, atol=0.02)


def test_a_robot_that_is_told_its_floor_knows_no_other():
    r = Recognition(OMNI, (SOFT,), known_only=True)
    assert r.names == ("soft",)
    np.testing.assert_array_equal(r.by_name(r.by_wheel(r.init().combinations)), np.ones((3, 1)))
    assert Recognition(OMNI, (SMOOTH, SOFT), known_only=True).names == ("smooth", "soft")
    with pytest.raises(InputError, match="known_only needs the floors"):
        Recognition(OMNI, known_only=True)


def test_bayes_rule():
    r = Recognition(RLMA, (SMOOTH, SOFT))
    assert len(r.combinations) == 5  # wheels that roll beside each other are not told apart
    prior = np.array([0.5, 0.3, 0.1, 0.05, 0.05])
    weights = prior * [1.0, 4.0, 2.0, 0.5, 0.0]
    found = r.posterior(prior, np.log(np.maximum([1.0, 4.0, 2.0, 0.5, 0.0], 1e-300)))
    np.testing.assert_allclose(found, weights / weights.sum(), atol=1e-12)


def state_of(r, combinations, averaged_s=2.0):
    return RecognitionState(r.usual, combinations, np.zeros(3), averaged_s)


def test_a_crossing_puts_one_wheel_on_another_floor_or_was_a_false_alarm():
    r = Recognition(OMNI, (SMOOTH, SOFT))
    start = np.eye(len(r.combinations))[0]  # all wheels on the first floor
    after = r.prior(state_of(r, start), True, False, 0.0)
    assert after[0] == pytest.approx(1 - RIGHT_SHARE)
    one_other = (r.combinations != 0).sum(axis=1) == 1
    assert after[one_other].sum() == pytest.approx(RIGHT_SHARE)


def test_what_was_recognised_counts_for_the_next_motion_and_is_forgotten_at_the_rate_of_crossings():
    r = Recognition(OMNI, (SMOOTH, SOFT), crossing_rate=0.2)
    start = np.eye(len(r.combinations))[0]
    np.testing.assert_allclose(r.prior(state_of(r, start), False, True, 0.0), start)
    np.testing.assert_allclose(r.prior(state_of(r, start), False, False, 1.5), r.usual)
    gone = 1 - np.exp(-0.2 * 1.5)
    np.testing.assert_allclose(
        r.prior(state_of(r, start), False, True, 1.5), (1 - gone) * start + gone * r.usual, rtol=1e-12
    )


def test_forces_are_averaged_since_the_last_event_and_those_of_a_start_are_left_out():
    r, state, dt_s = Recognition(OMNI, (SMOOTH, SOFT)), None, 0.1
    state = r.init()
    for k in range(25):
        state = state._replace(mean_N=(now := r.averaged(state, np.full(3, float(k)), False, False, dt_s))[0])
        state = state._replace(averaged_s=now[1])
    first = round(SETTLING_S / dt_s)  # sample k comes at k dt and settles until then
    assert state.averaged_s == pytest.approx(25 * dt_s - SETTLING_S)
    np.testing.assert_allclose(state.mean_N, np.mean(np.arange(first, 25)), rtol=1e-9)
    mean_N, averaged_s = r.averaged(state, np.full(3, 7.0), True, False, dt_s)
    assert averaged_s == 0.0
    np.testing.assert_array_equal(mean_N, 7.0)


def test_the_likelihood_of_a_combination_is_the_normal_density_of_its_forces():
    r, rng = Recognition(OMNI, (SMOOTH, SOFT), correlation_s=0.3), np.random.default_rng(2)
    motion, force, std = np.array([0.1, 0.05, 0.02]), rng.normal(0.0, 8.0, 3), np.array([1.0, 2.0, 3.0])
    friction, white = np.array([0.5, 0.1, 0.2]), 0.3 / 1.2
    persistent = PERSISTENT_SHARE + (1 - PERSISTENT_SHARE) * white
    D, load = drag_columns(OMNI, motion), static_loads(OMNI).mean()
    expected = []
    for combination in r.combinations:
        under = [r.all_floors[k] for k in combination]
        asked = np.column_stack([D[:, w] @ [f.rolling, f.roller] for w, f in enumerate(under)])
        off = asked * [f.drag_std for f in under]
        S = off @ off.T + np.diag(
            persistent * (load * max(f.force_std for f in under)) ** 2 + white * std**2 + friction**2
        )
        expected.append(multivariate_normal.logpdf(force, asked.sum(axis=1), S))
    found = r.log_likelihood(FloorForces(motion, force, std, friction), 1.2)
    np.testing.assert_allclose(found - found[0], np.array(expected) - expected[0], rtol=1e-9)


def test_floors_of_one_name_and_too_many_floors_are_refused():
    with pytest.raises(InputError, match="different names"):
        Recognition(OMNI, (SOFT, SOFT))
    with pytest.raises(InputError, match="combinations, more than 1000"):
        Recognition(OMNI, [replace(SOFT, name=str(k)) for k in range(12)])
