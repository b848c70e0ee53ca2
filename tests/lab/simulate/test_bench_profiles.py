import numpy as np
import pytest

from ohmward_lab.simulate import BATTERIES, resting_state, simulate
from ohmward_lab.simulate.profile import bench_times, low_rate_profile, pulse_profile, steps

LFP = BATTERIES["lfp"]


def charge_Ah(profile, part=1.0):
    i = np.where(part * profile.current_A > 0, profile.current_A, 0.0)
    return float(np.sum(0.5 * (i[1:] + i[:-1]) * np.diff(profile.time_s))) / 3600.0


def test_the_steps_of_the_pulse_test_take_the_capacity():
    profile = pulse_profile(12.0)
    pulses_Ah = 12 * 12.0 * 10.0 / 3600.0 - 11 * 9.0 * 10.0 / 3600.0
    edges_Ah = 0.01
    assert charge_Ah(profile, -1.0) + charge_Ah(profile) == pytest.approx(-(12.0 + pulses_Ah), abs=edges_Ah)


def test_the_pulse_test_has_a_pulse_of_1_C_at_each_of_12_levels():
    profile = pulse_profile(12.0)
    assert np.count_nonzero(np.diff((profile.current_A <= -12.0).astype(int)) == 1) == 12
    assert profile.current_A.max() == 9.0


def test_the_low_rate_test_goes_to_empty_and_back_to_full():
    profile = low_rate_profile(12.0)
    truth = simulate(LFP, profile, np.arange(0.0, profile.time_s[-1], 300.0), resting_state(LFP, 1.0), 100.0).truth
    assert truth.soc.min() < 0.01
    assert truth.soc[-1] > 0.99
    assert charge_Ah(profile, -1.0) == pytest.approx(-1.05 * 12.0, rel=1e-4)


def test_the_bench_logs_fast_around_pulses_and_slowly_at_rest():
    times = bench_times(steps([(100.0, 0.0), (20.0, -1.0), (300.0, 0.0)]))
    dt = np.diff(times)
    assert set(dt) == {1.0, 10.0}
    assert set(dt[(times[:-1] >= 100.0) & (times[:-1] < 179.0)]) == {1.0}
    assert set(dt[times[:-1] >= 190.0]) == {10.0}
