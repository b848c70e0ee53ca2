"""The compiler on a real filter: an adaptive unscented step on seven states."""

import time

import adaptive_ukf
import numpy as np
import pytest

from ohmward.trace import Kernel


@pytest.fixture(scope="module")
def kernel():
    return Kernel(adaptive_ukf.step, adaptive_ukf.initial(), (0.0, 0.0))


def test_the_program_is_as_small_as_the_algorithm(kernel):
    """764 products, 697 sums, 168 differences, 28 divisions, 7 roots; what grows here, grows everywhere."""
    assert 1600 < kernel.program.operations.total() < 1700
    assert kernel.program.operations["sqrt"] == 7


def test_the_scan_is_the_numpy_step(kernel):
    current_A, voltage_V = adaptive_ukf.log(150)
    state = adaptive_ukf.initial()
    means = []
    for sample in zip(current_A, voltage_V, strict=True):
        state, (mean, _) = adaptive_ukf.step(state, sample)
        means.append(mean)
    end, (scanned, _) = kernel.scan(adaptive_ukf.initial(), (current_A, voltage_V))
    np.testing.assert_allclose(scanned, means, rtol=0, atol=1e-12)
    np.testing.assert_allclose(end.cov, state.cov, rtol=1e-9, atol=1e-15)


def test_lanes_are_scans(kernel):
    current_A, voltage_V = adaptive_ukf.log(120, lanes=3)
    end, (mean, e) = kernel.scan_lanes(adaptive_ukf.initial(), (current_A, voltage_V))
    for lane in range(3):
        one, (one_mean, one_e) = kernel.scan(adaptive_ukf.initial(), (current_A[:, lane], voltage_V[:, lane]))
        np.testing.assert_allclose(mean[..., lane], one_mean, rtol=0, atol=1e-12)
        np.testing.assert_allclose(e[:, lane], one_e, rtol=0, atol=1e-12)
        np.testing.assert_allclose(end.squares[:, lane], one.squares, rtol=0, atol=1e-12)


def shortest_s(work, repeat=5):
    """Shortest processor time of a few runs [s]."""
    times = []
    for _ in range(repeat):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


@pytest.mark.slow
def test_machine_code_is_several_times_faster_than_numpy_and_lanes_than_one():
    """Eleven times here, and twenty with lanes of eight; in the same run, since a time judges the machine."""
    current_A, voltage_V = adaptive_ukf.log(2000)
    lanes = adaptive_ukf.log(50, lanes=1024)

    def in_numpy():
        state = adaptive_ukf.initial()
        for sample in zip(current_A[:100], voltage_V[:100], strict=True):
            state, _ = adaptive_ukf.step(state, sample)

    def compiled_anew():
        fresh = Kernel(adaptive_ukf.step, adaptive_ukf.initial(), (0.0, 0.0))
        fresh.scan(adaptive_ukf.initial(), (current_A[:1], voltage_V[:1]))
        return fresh

    kernel = compiled_anew()
    numpy_s = shortest_s(in_numpy) / 100
    one_s = shortest_s(lambda: kernel.scan(adaptive_ukf.initial(), (current_A, voltage_V))) / 2000
    lane_s = shortest_s(lambda: kernel.scan_lanes(adaptive_ukf.initial(), lanes)) / (50 * 1024)
    assert one_s < numpy_s / 4
    assert lane_s < one_s / 4
    assert shortest_s(compiled_anew, 3) < 500 * numpy_s
