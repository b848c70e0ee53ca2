from enum import IntFlag

import numpy as np

from ohmward.flags import count_flags


class Kind(IntFlag):
    LATE = 1
    LOST = 2
    NEVER = 4


def test_every_flag_is_counted_in_the_samples_that_carry_it():
    assert count_flags(np.array([0.0, 1.0, 3.0, 2.0, 2.0]), Kind) == {"late": 2, "lost": 3}


def test_nothing_happened():
    assert count_flags(np.zeros(3), Kind) == {}
