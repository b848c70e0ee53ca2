import numpy as np
import pytest

from ohmward.traction import RLMA
from ohmward.traction.friction.law import contact
from ohmward_lab.simulate.closed_loop.traction_plant import terrain_mixture
from ohmward_lab.simulate.ground import Patch

DRY, ICE = (Patch(friction=mu, rolling=c).ground(RLMA) for mu, c in ((0.8, 0.01), (0.1, 0.03)))
SPIN = contact(1.0, 0.5, 100.0)


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_forces_are_those_of_the_grounds_by_their_shares(share):
    ground = terrain_mixture([DRY, ICE], np.array([share, 1.0 - share]))
    assert ground.traction.force_N(SPIN) == pytest.approx(share * 80.0 + (1 - share) * 10.0)
    assert ground.rolling.force_N(2.0, 100.0) == pytest.approx(-(share * 1.0 + (1 - share) * 3.0))


def test_one_ground_is_itself():
    assert terrain_mixture([DRY], np.ones(1))[1:3] == DRY[1:3]


def test_a_law_in_common_is_taken_once():
    slippery = Patch(friction=0.1, rolling=0.01).ground(RLMA)
    assert terrain_mixture([DRY, slippery], np.array([0.5, 0.5])).rolling == DRY.rolling
