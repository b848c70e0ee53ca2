"""The table of the 36 elements in docs/odometry.md."""

import re
from pathlib import Path

import numpy as np

from ohmward.traction.odometry.nav_msgs import six_by_six

PAGE = Path(__file__).parents[3] / "docs" / "odometry.md"


def test_the_indices_of_the_covariance_are_those_of_the_code():
    cov = np.arange(1.0, 10.0).reshape(3, 3)
    found = six_by_six(cov)
    rows = re.findall(r"^\| \([^|]*\| ([\d, ]+) \| (`cov.*`) \|$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert len(rows) == 3
    for indices, elements in rows:
        places = re.findall(r"cov\[(\d), (\d)\]", elements)
        for index, (i, j) in zip(indices.split(","), places, strict=True):
            assert found[int(index)] == cov[int(i), int(j)]
