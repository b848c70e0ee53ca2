from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from ohmward.errors import InputError
from ohmward.traction import RLMA
from ohmward.traction.terrain.demand import drag_columns, static_loads
from ohmward.traction.terrain.recognition import UNSEEN_SHARE, Recognition
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


def test_before_anything_is_measured_known_floors_are_alike_and_a_new_one_is_unlikely():
    r = Recognition(OMNI, (SMOOTH, SOFT))
    share = r.by_wheel(r.init())
    np.testing.assert_allclose(share[:, 0], share[:, 1])
    assert np.all(share[:, 2] < 0.01)


def test_bayes_rule_on_one_sample():
    r = Recognition(RLMA, (SMOOTH, SOFT), crossing_rate=1e-12, correlation_s=1.0)
    assert len(r.combinations) == 3  # wheels that roll beside each other are not told apart
    after = r.step(np.array([0.5, 0.4, 0.1]), np.log([1.0, 4.0, 2.0]), 0.5)
    np.testing.assert_allclose(after, np.array([0.5, 0.8, 0.1 * np.sqrt(2)]) / (1.3 + 0.1 * np.sqrt(2)), rtol=1e-9)


def test_without_a_likelihood_wheels_meet_other_floors_one_by_one_at_the_rate_of_crossings():
    r = Recognition(OMNI, (SMOOTH, SOFT), crossing_rate=0.2)
    start = np.zeros(27)
    start[0] = 1.0  # all wheels on the first floor
    after = r.step(start, np.zeros(27), 1.5)
    gone = 1 - np.exp(-0.2 * 1.5)
    assert after[0] == pytest.approx(1 - gone)
    one_other = [c for c in range(27) if (r.combinations[c] > 0).sum() == 1]
    known = [c for c in one_other if r.combinations[c].max() == 1]
    assert after[one_other].sum() == pytest.approx(gone)
    np.testing.assert_allclose(after[known], gone / (3 * (1 + UNSEEN_SHARE)))


def test_the_likelihood_of_a_combination_is_the_normal_density_of_its_forces():
    r, rng = Recognition(OMNI, (SMOOTH, SOFT)), np.random.default_rng(2)
    motion, force, std = np.array([0.1, 0.05, 0.02]), rng.normal(0.0, 8.0, 3), np.array([1.0, 2.0, 3.0])
    D, load = drag_columns(OMNI, motion), static_loads(OMNI).mean()
    expected = []
    for combination in r.combinations:
        under = [r.all_floors[k] for k in combination]
        asked = np.column_stack([D[:, w] @ [f.rolling, f.roller] for w, f in enumerate(under)])
        off = asked * [f.drag_std for f in under]
        S = off @ off.T + np.diag((load * max(f.force_std for f in under)) ** 2 + std**2)
        expected.append(multivariate_normal.logpdf(force, asked.sum(axis=1), S))
    found = r.log_likelihood(motion, np.zeros(3), force, std)
    np.testing.assert_allclose(found - found[0], np.array(expected) - expected[0], rtol=1e-9)


def test_floors_of_one_name_and_too_many_floors_are_refused():
    with pytest.raises(InputError, match="different names"):
        Recognition(OMNI, (SOFT, SOFT))
    with pytest.raises(InputError, match="combinations, more than 1000"):
        Recognition(OMNI, [replace(SOFT, name=str(k)) for k in range(12)])
