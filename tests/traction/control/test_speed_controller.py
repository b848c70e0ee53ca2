"""Speed within bounds of slip."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.trace import Kernel
from ohmward.traction.control import ControlFlag, Limits, Measurement, SpeedCommand, SpeedController
from traction.control.examples import DRY, LIMITS, SLIDING, SLIPPERY, WHEEL, Truth, drive, measured, turn

DT = 1e-3
CONTROL = SpeedController(WHEEL, SLIDING, LIMITS)


def go(speed, bound=0.12):
    return lambda _: SpeedCommand(speed, bound)


def slips_m_s(steps):
    return np.array([WHEEL.radius_m * x.wheel_speed_rad_s - x.speed_m_s for x, _, _ in steps])


def flagged(steps, flag):
    return np.array([bool(int(report.flags) & flag) for _, _, report in steps])


def test_where_the_wheel_grips_the_speed_follows_its_ramp():
    steps = drive(CONTROL, go(0.5), DRY, 2.5)
    speeds = np.array([x.speed_m_s for x, _, _ in steps])
    assert speeds[499] == pytest.approx(0.25, abs=0.02)
    assert speeds[-1] == pytest.approx(0.5, abs=0.002)
    assert flagged(steps, ControlFlag.SLIP_BOUND).mean() < 0.01


def test_a_ramp_that_eases_off_covers_as_much_in_the_same_time_with_eight_ninths_of_the_loss():
    state, loss, way = CONTROL.init(measured(Truth())), 0.0, 0.0
    eased = SpeedController(WHEEL, SLIDING, LIMITS, acceleration_m_s2=2 / 3, easing_m_s=1.0)
    for _ in range(3000):
        a = eased.ramp_m_s2(state, SpeedCommand(1.0), DT)
        state = state._replace(reference_m_s=state.reference_m_s + a * DT)
        loss, way = loss + a * a * DT, way + state.reference_m_s * DT
    assert state.reference_m_s == pytest.approx(1.0, abs=1e-3)
    assert way == pytest.approx(2.0, abs=0.01)  # as 0.5 m/s^2 for 2 s and 1 m/s for 1 s
    assert loss == pytest.approx(8 / 9 * 0.5, rel=0.01)


def test_where_the_ground_gives_way_slip_stays_at_its_bound_and_it_is_said():
    hard = SpeedController(WHEEL, SLIDING, LIMITS, acceleration_m_s2=4.0)
    steps = drive(hard, go(3.0), SLIPPERY, 1.0)
    speed = np.array([WHEEL.radius_m * x.wheel_speed_rad_s for x, _, _ in steps])
    bound = np.maximum(0.12 * speed, hard.creep_m_s)
    assert (slips_m_s(steps) <= bound + 0.01).all()
    assert flagged(steps, ControlFlag.SLIP_BOUND)[100:].all()
    assert slips_m_s(steps)[100:] == pytest.approx(bound[100:], abs=0.003)


def test_braking_has_its_bound_too():
    hard = SpeedController(WHEEL, SLIDING, LIMITS, acceleration_m_s2=8.0)
    steps = drive(hard, go(0.0), SLIPPERY, 0.5, start=Truth(2.0 / WHEEL.radius_m, 2.0))
    assert slips_m_s(steps).min() >= -0.12 * 2.0 - 0.01
    assert flagged(steps, ControlFlag.SLIP_BOUND)[100:].all()


def test_after_a_slippery_stretch_the_speed_does_not_overshoot():
    hard = SpeedController(WHEEL, SLIDING, LIMITS, acceleration_m_s2=4.0)
    x, state, speeds = Truth(), hard.init(measured(Truth())), []
    for k in range(3000):
        state, torque, _ = hard.step(state, SpeedCommand(1.0), measured(x), DT)
        x = turn(x, torque, SLIPPERY if k < 400 else DRY, DT)
        speeds.append(x.speed_m_s)
    assert max(speeds) <= 1.0 + 0.12
    assert speeds[-1] == pytest.approx(1.0, abs=0.005)


def test_the_integral_waits_while_the_slip_is_bounded():
    hard = SpeedController(WHEEL, SLIDING, LIMITS, acceleration_m_s2=50.0)
    x = Truth()
    state = hard.init(measured(x))
    for k in range(1500):
        state, torque, _ = hard.step(state, SpeedCommand(3.0), measured(x), DT)
        x = turn(x, torque, SLIPPERY, DT)
        if k == 200:
            early = state.integral_m
    assert x.speed_m_s < 2.5
    assert state.integral_m == pytest.approx(early, abs=1e-12)


def test_the_integral_waits_where_a_hill_is_too_steep_for_the_motor():
    weak, x = SpeedController(WHEEL, SLIDING, Limits(1.0)), Truth(1.0 / WHEEL.radius_m, 1.0)
    state = weak.init(measured(x))
    for _ in range(700):
        state, torque, _ = weak.step(state, SpeedCommand(1.0), measured(x), DT)
        x = turn(x, torque, DRY, DT, pull_N=20.0)
    assert torque == 1.0
    assert x.speed_m_s < 0.7
    needed_N = 1.0 / WHEEL.radius_m
    assert WHEEL.mass_kg * weak.bandwidth_rad_s**2 * state.integral_m < needed_N


def test_reverse_is_the_mirror_image():
    ahead, back = (drive(CONTROL, go(v), SLIPPERY, 0.5, pull_N=0.0) for v in (1.0, -1.0))
    assert [t for _, t, _ in back] == pytest.approx([-t for _, t, _ in ahead], abs=1e-9)


def test_a_robot_that_stands_holds_its_place_on_a_slope():
    start = Truth(0.02 / WHEEL.radius_m, 0.02)
    steps = drive(CONTROL, go(0.0), DRY, 6.0, start=start, pull_N=10.0)
    assert flagged(steps, ControlFlag.STOPPED)[-1]
    assert steps[-1][1] == pytest.approx(10.0 * WHEEL.radius_m, rel=0.02)
    rim = np.array([WHEEL.radius_m * x.wheel_speed_rad_s for x, _, _ in steps])
    assert abs(rim[-1]) < 1e-3
    assert abs(np.sum(rim) * DT) < 0.06


def test_it_starts_uphill_with_a_bound_that_would_be_no_force_at_rest():
    steps = drive(CONTROL, go(0.5, 0.03), DRY, 2.5, pull_N=15.0)
    assert min(x.speed_m_s for x, _, _ in steps) > -0.03
    assert steps[-1][0].speed_m_s == pytest.approx(0.5, abs=0.02)


anything = st.one_of(st.floats(-50, 50), st.just(math.nan), st.just(-math.inf))


@settings(max_examples=60)
@given(st.lists(st.tuples(anything, anything, anything, st.floats(-0.5, 1.5)), min_size=2, max_size=12))
def test_the_limits_are_never_exceeded_whatever_comes(sequence):
    control = SpeedController(WHEEL, SLIDING, Limits(5.0, 800.0))
    state, before = control.init(Measurement(*sequence[0][:2])), 0.0
    for omega, v, speed, bound in sequence:
        state, torque, _ = control.step(state, SpeedCommand(speed, bound), Measurement(omega, v), DT)
        assert abs(torque) <= 5.0
        assert abs(torque - before) <= 0.8 + 1e-9
        before = torque


@pytest.mark.parametrize(
    "command", [SpeedCommand(math.nan), SpeedCommand(math.inf), SpeedCommand(1.0, 0.0), SpeedCommand(1.0, 5e-324)]
)
def test_a_command_that_is_none_is_said_and_gives_no_torque(command):
    steps = drive(CONTROL, lambda _: command, DRY, 0.05)
    assert flagged(steps, ControlFlag.BAD_COMMAND).all()
    assert {torque for _, torque, _ in steps} == {0.0}


def test_a_stale_speed_takes_the_torque_away_and_the_ramp_starts_anew():
    x, state = Truth(), CONTROL.init(measured(Truth()))
    for _ in range(500):
        state, torque, _ = CONTROL.step(state, SpeedCommand(1.0), measured(x), DT)
    assert torque > 1.0
    for _ in range(5):
        state, torque, report = CONTROL.step(state, SpeedCommand(1.0), Measurement(0.0, 0.0, 0.2), DT)
    assert (torque, state.integral_m, state.reference_m_s) == (0.0, 0.0, 0.0)
    assert int(report.flags) & ControlFlag.STALE


def test_it_traces_and_the_compiled_step_is_the_same():
    state = CONTROL.init(Measurement(0.0, 0.0))
    kernel = Kernel(CONTROL.step, state, SpeedCommand(1.0, 0.1), Measurement(0.0, 0.0, 0.0, 0.0), DT)
    rng = np.random.default_rng(3)
    for _ in range(20):
        m = Measurement(rng.uniform(-5, 15), rng.uniform(0, 1), rng.uniform(0, 0.11), 0.0)
        compiled = kernel(state, SpeedCommand(1.0, 0.1), m, DT)
        state, torque, report = CONTROL.step(state, SpeedCommand(1.0, 0.1), m, DT)
        assert compiled[1] == pytest.approx(torque, abs=1e-9)
        assert compiled[2] == pytest.approx(tuple(report), nan_ok=True)


def test_bad_settings_are_refused():
    with pytest.raises(InputError, match=r"speed_controller.creep_m_s must be > 0"):
        SpeedController(WHEEL, SLIDING, LIMITS, creep_m_s=0.0)
