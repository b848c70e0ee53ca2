"""Values in the types of JSON: what every command and every sink of the process writes."""

import json
import math
from collections import namedtuple
from dataclasses import dataclass
from enum import IntEnum, IntFlag, StrEnum
from pathlib import Path

import numpy as np
import pytest

from ohmward.json_values import plain


class Colour(IntEnum):
    RED = 1


class Phase(StrEnum):
    DRIVING = "driving"


class Fault(IntFlag):
    NO_CURRENT = 1
    GAP = 2
    LATE = 4


@dataclass
class Cell:
    capacity_Ah: float
    name: str


Pair = namedtuple("Pair", "first second")


@pytest.mark.parametrize(
    "value, expected",
    [
        (1.5, 1.5),
        (math.nan, None),
        (-math.inf, None),
        (np.float64(2.5), 2.5),
        (np.float32("nan"), None),
        (np.int64(3), 3),
        (True, True),
        (None, None),
        ("text", "text"),
        (Path("a") / "b", str(Path("a") / "b")),
        (Colour.RED, "RED"),
        (Phase.DRIVING, "driving"),
        (Fault.NO_CURRENT | Fault.LATE, ["NO_CURRENT", "LATE"]),
        (Fault(0), []),
        (np.array([[1.0, math.nan], [math.inf, 2.0]]), [[1.0, None], [None, 2.0]]),
        ({1: (math.nan, 2)}, {"1": [None, 2]}),
        (Pair(1, Cell(math.nan, "x")), {"first": 1, "second": {"capacity_Ah": None, "name": "x"}}),
    ],
)
def test_it_becomes(value, expected):
    assert json.loads(json.dumps(plain(value), allow_nan=False)) == expected
