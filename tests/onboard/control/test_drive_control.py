"""The controller with its safety, on a clock of the test."""

import math

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.onboard.control.drive_control import DriveControl, DrivePhase
from ohmward.onboard.control.operator_command import SAFE_STOP_S, DriveLimits, OperatorCommand, command_of
from ohmward.onboard.robot_state import RobotState
from ohmward.traction.robot.packaged import RLMA
from ohmward.traction.speed_observer.estimator import SlipEstimator
from ohmward_lab.simulate.closed_loop import Command, Patch, Scenario
from ohmward_lab.simulate.closed_loop.loop import make_plant

STEP_S = 0.01
FIRST = SlipEstimator(RLMA).update(0.0, wheel_speed_rad_s=[0.0] * 4, current_A=[0.0] * RLMA.driven)


def state(now_s, speed_m_s=0.0, wheel_speed_rad_s=0.0, std=0.005, turn=0.0):
    slip = FIRST._replace(
        speed_m_s=speed_m_s,
        yaw_rate_rad_s=turn,
        wheel_speed_rad_s=np.broadcast_to(np.asarray(wheel_speed_rad_s, float), RLMA.driven).copy(),
        speed_std_m_s=std,
    )
    return RobotState(now_s, 0.0, slip=slip, drive_time_s=now_s)


def operator(now_s, armed=True, speed=0.0, **more):
    return OperatorCommand(armed, speed, given_s=now_s, **more)


def armed(limits=None, at_s=1.0):
    """A controller that has been armed at rest at a time, and the last step before it."""
    control = DriveControl(RLMA, limits or DriveLimits())
    control.step(at_s - 2 * STEP_S, state(at_s - 2 * STEP_S), operator(at_s - 2 * STEP_S, False))
    output = control.step(at_s - STEP_S, state(at_s - STEP_S), operator(at_s - STEP_S))
    assert output.phase == DrivePhase.ARMED, output.reason
    return control


def is_off(control, output):
    numbers = control.numbers(output)
    moves = [value for name, value in numbers.items() if "." in name]
    return numbers["enable"] == 0.0 and moves == [0.0] * len(moves)


def test_nothing_moves_before_it_is_armed():
    control = DriveControl(RLMA, DriveLimits())
    for now_s, command, reason in (
        (0.0, None, "no operator"),
        (0.1, operator(0.1, armed=False, speed=0.3), "not armed"),
        (0.2, operator(0.2, armed=True, speed=0.3), "set speed, turn and slip to 0 to arm"),
        (0.3, operator(0.1, armed=True), "nothing from the operator for 200 ms"),
    ):
        output = control.step(now_s, state(now_s), command)
        assert is_off(control, output) and output.phase == DrivePhase.DISARMED
        assert output.reason == reason
    output = control.step(0.4, state(0.2), operator(0.4))
    assert is_off(control, output) and output.reason == "the estimate is 200 ms old"


def test_an_armed_robot_drives():
    control = armed()
    output = control.step(1.0, state(1.0), operator(1.0, speed=0.3))
    for k in range(1, 6):
        output = control.step(1.0 + k * STEP_S, state(1.0 + k * STEP_S), operator(1.0 + k * STEP_S, speed=0.3))
    assert output.phase == DrivePhase.ARMED and control.numbers(output)["enable"] == 1.0
    assert (output.torque_Nm > 0.0).all() and (output.wheel_speed_rad_s > 0.0).all()


FAULTS = {
    "stale estimate": lambda t: (state(1.0), operator(t, speed=0.3), "the estimate is"),
    "lost heartbeat": lambda t: (state(t), operator(1.0, speed=0.3), "nothing from the operator"),
    "lost operator": lambda t: (state(t), None, "the operator is gone"),
    "no state": lambda t: (None, operator(t, speed=0.3), "no estimate"),
    "exception": lambda t: (state(t)._replace(slip="nonsense"), operator(t, speed=0.3), "fault of the controller"),
    "not a number": lambda t: (state(t, std=math.nan), operator(t, speed=0.3), "the speed is too uncertain"),
    "uncertain": lambda t: (state(t, std=0.5), operator(t, speed=0.3), "the speed is too uncertain"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_is_a_safe_stop_within_100_ms_that_stays(fault):
    control = armed()
    control.step(1.0, state(1.0), operator(1.0, speed=0.3))
    for k in range(1, 20):
        t = 1.0 + k * STEP_S
        now, command, reason = FAULTS[fault](t)
        output = control.step(t, now, command)
        if output.phase == DrivePhase.STOPPED:
            break
    assert t - 1.0 + STEP_S <= SAFE_STOP_S + 1e-9
    assert is_off(control, output) and output.reason.startswith(reason)
    good = control.step(t + STEP_S, state(t + STEP_S), operator(t + STEP_S, speed=0.3))
    assert good.phase == DrivePhase.STOPPED and is_off(control, good)
    t += 2 * STEP_S
    assert control.step(t, state(t), operator(t, armed=False)).phase == DrivePhase.DISARMED
    t += STEP_S
    assert control.step(t, state(t), operator(t)).phase == DrivePhase.ARMED


def test_a_loop_that_was_held_up_is_a_fault():
    control = armed()
    control.step(1.0, state(1.0), operator(1.0))
    output = control.step(1.3, state(1.3), operator(1.3))
    assert output.phase == DrivePhase.STOPPED and "held up for 300 ms" in output.reason


def test_a_stop_that_is_asked_for_comes_with_the_next_step():
    control = armed()
    control.request_stop("stopped by an operator")
    output = control.step(1.0, state(1.0), operator(1.0, speed=0.3))
    assert output.phase == DrivePhase.STOPPED and is_off(control, output)


def test_set_points_stay_within_the_limits():
    limits = DriveLimits(speed_m_s=0.2, torque_Nm=1.5, slip=0.1)
    command = operator(1.0, speed=9.0, yaw_rate_rad_s=-9.0, slip_ratio=0.5, slip_bound=0.9).limited(limits)
    assert (command.speed_m_s, command.yaw_rate_rad_s) == (0.2, -1.0)
    assert (command.slip_ratio, command.slip_bound) == (0.1, 0.1)
    control = armed(limits)
    for k in range(100):
        t = 1.0 + k * STEP_S
        output = control.step(t, state(t), operator(t, speed=9.0))
        assert (abs(output.torque_Nm) <= 1.5 + 1e-12).all()


@pytest.mark.parametrize("words", [{"speed_m_s": math.nan}, {"speed_m_s": "fast"}, {"slip_bound": None}])
def test_a_command_that_is_no_number_is_none(words):
    assert command_of({"armed": True} | words, 1.0) is None


def test_only_true_arms():
    for word in (1, "yes", "true", [1], None):
        found = command_of({"armed": word}, 1.0)
        assert found is not None and not found.armed


def drive(ground, commanded, seconds=4.0, wheel_speeds=False, **more):
    """The robot of the simulation under this controller, with the true speed for its estimate: truth over time."""
    plant = make_plant(Scenario(seconds, (Command(speed_m_s=0.0),), ground=(ground,)))
    truth, control, found = plant.reset(), DriveControl(RLMA, DriveLimits(torque_Nm=12.0)), []
    torque = np.zeros(RLMA.driven)
    for k in range(round(seconds / STEP_S)):
        t = k * STEP_S
        now = state(t, truth.speed_m_s, truth.wheel_speed_rad_s[: RLMA.driven], turn=truth.yaw_rate_rad_s)
        command = operator(t, k > 0, commanded if k > 2 else 0.0, **(more if k > 2 else {}))
        output = control.step(t, now, command)
        assert k < 2 or output.phase == DrivePhase.ARMED, output.reason
        for _ in range(10):
            if wheel_speeds:  # a drive with a fast loop of its own
                error = output.wheel_speed_rad_s - truth.wheel_speed_rad_s[: RLMA.driven]
                torque = np.clip(torque + 40.0 * 1e-3 * error, -12.0, 12.0)
                truth = plant.step(torque + 2.0 * error, 1e-3)
            else:
                truth = plant.step(output.torque_Nm, 1e-3)
        found.append(truth)
    return found


@pytest.mark.parametrize("wheel_speeds", [False, True])
def test_it_holds_the_speed_on_a_good_floor(wheel_speeds):
    found = drive(Patch(friction=0.8, rolling=0.02), 0.4, wheel_speeds=wheel_speeds)
    assert np.mean([truth.speed_m_s for truth in found[-100:]]) == pytest.approx(0.4, abs=0.03)


@pytest.mark.parametrize("wheel_speeds", [False, True])
def test_the_slip_stays_at_its_bound_on_ice(wheel_speeds):
    """Wheels that would spin with all of their torque slip by no more than the bound and the creep."""
    found = drive(Patch(friction=0.03, rolling=0.005), 0.5, wheel_speeds=wheel_speeds, slip_bound=0.15)
    later = found[100:]
    slips = np.array([truth.slip_speed_m_s[: RLMA.driven] for truth in later])
    speeds = np.array([truth.speed_m_s for truth in later])
    assert speeds[-1] > 0.1
    assert np.percentile(slips - np.maximum(0.15 / 0.85 * speeds, 0.06)[:, None], 95) < 0.03


def test_limits_are_checked():
    for settings, message in (
        ({"speed_m_s": 0.0}, "limits.speed_m_s must be > 0"),
        ({"slip": 1.0}, "limits.slip must be between"),
        ({"operator_timeout_s": 5.0}, "limits.operator_timeout_s must be between"),
    ):
        with pytest.raises(InputError, match=message):
            DriveLimits(**settings)
