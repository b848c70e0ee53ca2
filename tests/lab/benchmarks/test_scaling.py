"""The chain that states are counted with: ours and FilterPy's are one filter."""

from functools import partial

import numpy as np
import pytest

from ohmward.trace import Kernel
from scripts import script

pytest.importorskip("llvmlite")
scaling = script("scaling")


@pytest.mark.parametrize("n", [2, 5])
def test_the_jacobian_is_that_of_the_chain(n):
    x, step = np.linspace(-0.5, 0.7, n), 1e-6
    columns = [(scaling.chain_next(x + d, 0.3) - scaling.chain_next(x - d, 0.3)) / (2 * step) for d in step * np.eye(n)]
    np.testing.assert_allclose(scaling.chain_jacobian(x), np.array(columns).T, atol=1e-9)


@pytest.mark.parametrize("method", ["EKF", "UKF"])
@pytest.mark.parametrize("n", [2, 5])
def test_filterpy_comes_to_our_numbers(method, n):
    pytest.importorskip("filterpy")
    kernel = Kernel(partial(scaling.chain_step, scaling.METHODS[method]), scaling.chain_start(n), (0.0, 0.0))
    ours, _ = kernel.scan(scaling.chain_start(n), scaling.chain_log(scaling.PEER_STEPS))
    theirs = scaling.filterpy_chain(method, n)()
    np.testing.assert_allclose(ours.mean, theirs.mean, atol=1e-12)
    np.testing.assert_allclose(ours.cov, theirs.cov, atol=1e-14)


def test_memory_beyond_the_log_is_flat():
    section = scaling.length_section(1, (1000, 20_000))
    megabytes = [float(row[3].split()[0]) for row in section.rows]
    assert max(megabytes) < 0.1


def test_many_logs_need_no_second_copy_of_their_estimates():
    section = scaling.logs_section(1, (8, 256))
    megabytes = [float(row[-1].split()[0]) for row in section.rows]
    estimates = 256 * scaling.LANE_STEPS * 9 * 8 / 1e6
    assert max(megabytes) < 0.1 * estimates
