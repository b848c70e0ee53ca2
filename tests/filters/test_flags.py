from enum import IntFlag

import numpy as np

from ohmward.filters.flags import count_flags, flags_of


class Kind(IntFlag):
    LATE = 1
    DIVERGED = 2
    NEVER = 4


def test_every_flag_is_counted_in_the_samples_that_carry_it():
    assert count_flags(np.array([0.0, 1.0, 3.0, 2.0, 2.0]), Kind) == {"late": 2, "diverged": 3}


def test_nothing_happened():
    assert count_flags(np.zeros(3), Kind) == {}


def test_flags_of_is_the_union_of_those_whose_condition_holds():
    assert flags_of({Kind.LATE: True, Kind.DIVERGED: 1.0 > 2.0, Kind.NEVER: True}) == Kind.LATE | Kind.NEVER
