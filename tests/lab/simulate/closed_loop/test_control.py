import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.trace import Kernel
from ohmward.traction import RLMA, ROBOTINO
from ohmward.traction.control import Measurement
from ohmward_lab.simulate.closed_loop.control import (
    CASCADE_S,
    LAWS,
    MODES,
    Command,
    Control,
    make_controller,
    wheel_command,
)

DT = 1e-3
REST = Measurement(np.zeros(2), np.zeros(2), 0.0, np.zeros(2))
COMMANDS = {
    "speed": Command(speed_m_s=0.5),
    "slip": Command(slip_ratio=0.12),
    "torque": Command(torque_Nm=2.0),
    "wheel-speed": Command(speed_m_s=0.5),
    "ramp": Command(speed_m_s=0.5),
}


def torques(control, command, steps=200, wheel_speed_rad_s=0.0):
    """(steps, 2) that the compiled controller gives to wheels that do not move."""
    controller = make_controller(control, RLMA)
    at = REST._replace(wheel_speed_rad_s=np.full(2, wheel_speed_rad_s))
    state, goal = controller.init(at, 0.0), wheel_command(command, RLMA)
    step = Kernel(controller.step, state, goal, at, DT)
    given = []
    for _ in range(steps):
        state, torque, _ = step(state, goal, at, DT)
        given.append(torque)
    return np.array(given)


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_starts_a_robot_in_both_directions(mode):
    command = COMMANDS[mode]
    back = {
        "slip": Command(slip_ratio=0.12, reverse=True),
        "torque": Command(torque_Nm=-2.0),
    }
    forward = torques(Control(mode), command)
    reverse = torques(Control(mode), back.get(mode, Command(speed_m_s=-0.5)))
    assert forward[-1].min() > 0.1
    assert reverse == pytest.approx(-forward, rel=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_every_law_compiles_and_stays_within_the_limits(law):
    given = torques(Control("slip", law, torque_limit_Nm=3.0, torque_rate_Nm_per_s=100.0), COMMANDS["slip"])
    assert np.abs(given).max() <= 3.0 + 1e-12
    assert np.abs(np.diff(given, axis=0)).max() <= 0.1 + 1e-12


def test_open_loop_gives_the_torque_at_its_rate():
    given = torques(Control("torque", torque_rate_Nm_per_s=1000.0), Command(torque_Nm=2.0), steps=4)
    assert given[:, 0] == pytest.approx([1.0, 2.0, 2.0, 2.0])


def test_the_ramp_asks_for_less_at_first():
    ramp = torques(Control("ramp", acceleration_m_s2=0.5), COMMANDS["ramp"], steps=1)
    assert ramp[0, 0] == pytest.approx(2.0 * 0.5 * DT / 0.12)
    assert torques(Control("wheel-speed"), COMMANDS["ramp"], steps=10)[-1, 0] > 5.0


def test_the_cascade_gives_a_new_wheel_speed_fifty_times_a_second():
    controller = make_controller(Control("slip", "cascade"), RLMA)
    state, goal = controller.init(REST, 0.0), wheel_command(Command(slip_ratio=0.12), RLMA)
    references = []
    for k in range(101):
        faster = REST._replace(travel_speed_m_s=np.full(2, k * DT))
        state, _, _ = controller.step(state, goal, faster, DT)
        references.append(float(state[0].reference_rad_s))
    assert (np.flatnonzero(np.diff(references)) + 1).tolist() == [round(CASCADE_S / DT) * k for k in range(1, 6)]


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_takes_over_from_the_torque_that_is_given(mode):
    rate_Nm_per_s = 1000.0
    controller = make_controller(Control(mode, torque_rate_Nm_per_s=rate_Nm_per_s), RLMA)
    state = controller.init(REST, np.array([3.0, -3.0]))
    _, torque, _ = controller.step(state, wheel_command(COMMANDS[mode], RLMA), REST, DT)
    assert np.abs(torque - [3.0, -3.0]).max() <= rate_Nm_per_s * DT + 1e-9


def test_a_command_may_have_a_mode_of_its_own():
    control = Control("speed")
    control.check(Command(slip_ratio=-0.18, mode="slip"))
    assert control.mode_of(Command(slip_ratio=-0.18, mode="slip")) == "slip"
    assert control.mode_of(Command(speed_m_s=1.0)) == "speed"


def test_a_turn_asks_each_wheel_for_its_own_speed():
    goal = wheel_command(Command(speed_m_s=0.5, yaw_rate_rad_s=1.0), RLMA)
    assert goal.travel_m_s == pytest.approx([0.35, 0.65])
    turning = wheel_command(Command(speed_m_s=0.0, yaw_rate_rad_s=1.0), ROBOTINO)
    assert turning.travel_m_s == pytest.approx([0.125] * 3)


@pytest.mark.parametrize(
    "control, command, message",
    [
        (Control("speed"), Command(slip_ratio=0.1), "commands.speed_m_s is missing"),
        (
            Control("speed"),
            Command(speed_m_s=0.1, slip_ratio=0.1),
            "commands.slip_ratio is not taken by controller.mode",
        ),
        (Control("slip"), Command(slip_ratio=0.1, yaw_rate_rad_s=1.0), "which takes slip_ratio, reverse; remove it"),
        (Control("speed"), Command(speed_m_s=0.1, mode="slip"), 'slip_ratio is missing; commands.mode = "slip"'),
        (Control("torque"), Command(torque_Nm=20.0), r"commands.torque_Nm must be within ± 12 .* got 20"),
    ],
)
def test_commands_that_do_not_fit_are_refused(control, command, message):
    with pytest.raises(InputError, match=message):
        control.check(command)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Control("fly"), "controller.mode must be one of speed, slip, .* got 'fly'"),
        (lambda: Command(mode="fly"), "commands.mode must be one of speed, slip, .* got 'fly'"),
        (lambda: Control("slip", "bang"), "controller.law must be one of sliding-mode, .* got 'bang'"),
        (lambda: Control(torque_limit_Nm=0.0), "controller.torque_limit_Nm must be > 0"),
        (lambda: Control(interval_s=1.0), "controller.interval_s must be between"),
        (lambda: Command(slip_ratio=12.0), r"commands.slip_ratio must be between -1 and 1 \(0.12 is 12 %\), got 12"),
        (lambda: Command(from_s=-1.0), "commands.from_s must be >= 0"),
    ],
)
def test_impossible_settings_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
