"""Damaged logs of all formats: refused, or a log that can be; `python benchmarks/log_fuzz.py` takes 100,000."""

import warnings

import numpy as np
import pytest

from logs.formats.mutation import damaged
from ohmward.errors import OhmwardError
from ohmward.logs import read_log


@pytest.mark.parametrize("seed", [1, 2])
def test_a_damaged_file_is_read_or_refused(seed, tmp_path):
    pytest.importorskip("h5py")
    pytest.importorskip("openpyxl")
    read = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for path in damaged(tmp_path, np.random.default_rng(seed), 250):
            try:
                log = read_log(path)
            except OhmwardError:
                continue
            read += 1
            assert (np.diff(log.time_s) > 0).all()
            assert not np.isinf(log.current_A).any() and not np.isinf(log.voltage_V).any()
    assert read > 10
