"""The shell: limits, reverse, dropouts, standstill, and the laws in closed loop."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.trace import Kernel
from ohmward.traction.control import (
    ControlFlag,
    Limits,
    Measurement,
    SlidingMode,
    SlipCommand,
    SlipController,
)
from ohmward.traction.control.slip_law import SlipLaw
from ohmward_lab.traction.compared_slip_laws import FuzzySlidingMode, SlipPid, SlipRatioSlidingMode
from traction.control.examples import DRY, LIMITS, SLIDING, SLIPPERY, UNSURE, WHEEL, Truth, drive, measured

LAWS: dict[str, SlipLaw] = {
    "sliding": SLIDING,
    "sliding with integral": SlidingMode(UNSURE, integral_per_s=3.0),
    "fuzzy": FuzzySlidingMode(SLIDING),
    "pid": SlipPid(),
    "slip ratio": SlipRatioSlidingMode(UNSURE),
}
DT = 1e-3


def controller(law=SLIDING, **changes):
    return replace(SlipController(WHEEL, law, LIMITS), **changes)


def hold(slip_ratio, direction=1.0):
    return lambda _: SlipCommand(slip_ratio, direction)


def flagged(steps, flag):
    return [bool(int(report.flags) & flag) for _, _, report in steps]


@pytest.mark.parametrize("law", [LAWS[name] for name in LAWS if name != "slip ratio"])
@pytest.mark.parametrize("ground", [DRY, SLIPPERY], ids=["dry", "slippery"])
def test_from_rest_to_a_slip_whatever_the_friction(law, ground):
    steps = drive(controller(law, floor_m_s=0.2, launch=1.0), hold(0.12), ground, 0.6)
    slips = np.array([report.slip_ratio for _, _, report in steps])
    assert np.abs(slips[320:] - 0.12).max() <= 0.02
    changes = np.abs(np.diff([torque for _, torque, _ in steps]))
    assert changes.max() < 0.5, "a limit cycle at the start"
    assert changes[200:].max() < 0.03


def test_a_launch_gets_there_earlier():
    early, late = (drive(controller(launch=n), hold(0.12), DRY, 0.4) for n in (6.0, 1.0))
    assert arrival_s(early) < 0.19 < 0.22 < arrival_s(late)


def arrival_s(steps):
    slips = np.array([report.slip_ratio for _, _, report in steps])
    return DT * np.flatnonzero(~(np.abs(slips - 0.12) <= 0.02))[-1]


def test_braking_knows_no_launch():
    start = Truth(0.2 / WHEEL.radius_m, 0.2)
    short, tall = (drive(controller(launch=n), hold(-0.18), DRY, 0.05, start=start) for n in (1.0, 9.0))
    assert [x for x, _, _ in short] == [x for x, _, _ in tall]


def test_the_slip_ratio_law_holds_a_moving_robot():
    rolling = Truth(1.0 / WHEEL.radius_m, 1.0)
    steps = drive(controller(LAWS["slip ratio"]), hold(0.12), SLIPPERY, 0.5, start=rolling)
    assert np.abs([report.slip_ratio - 0.12 for _, _, report in steps[400:]]).max() <= 0.02


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize("slip", [0.12, -0.18])
def test_reverse_is_the_mirror_image(law, slip):
    start = Truth(1.5 / WHEEL.radius_m, 1.5)
    ahead = drive(controller(law), hold(slip), SLIPPERY, 0.2, start=start)
    back = drive(controller(law), hold(slip, -1.0), SLIPPERY, 0.2, start=Truth(-start[0], -start[1]))
    for (x, torque, seen), (y, opposite, mirrored) in zip(ahead, back, strict=True):
        assert y == pytest.approx((-x[0], -x[1]), rel=1e-9)
        assert opposite == pytest.approx(-torque, abs=1e-9)
        assert mirrored.slip_ratio == pytest.approx(seen.slip_ratio)
        assert mirrored.flags == seen.flags


def test_braking_opposes_travel_whatever_direction_is_commanded():
    start = Truth(-1.5 / WHEEL.radius_m, -1.5)
    steps = drive(controller(), hold(-0.18, 1.0), SLIPPERY, 0.3, start=start)
    assert steps[-1][0].speed_m_s > -1.3
    assert steps[-1][2].slip_ratio == pytest.approx(-0.18, abs=0.01)


def test_braking_ends_in_a_stop_without_torque():
    start = Truth(0.5 / WHEEL.radius_m, 0.5)
    steps = drive(controller(), hold(-0.18), DRY, 1.0, start=start)
    assert flagged(steps, ControlFlag.STOPPED)[-1]
    assert steps[-1][1] == 0.0
    assert abs(steps[-1][0].speed_m_s) < 0.05
    assert min(x.speed_m_s for x, _, _ in steps) > -0.05


anything = st.one_of(st.floats(-50, 50), st.just(math.nan), st.just(math.inf))
readings = st.tuples(anything, anything, st.floats(0, 0.3), st.floats(-1.2, 1.2), st.sampled_from([-1.0, 1.0]))


@settings(max_examples=60)
@given(st.lists(readings, min_size=2, max_size=12), st.sampled_from(list(LAWS)))
def test_the_limits_are_never_exceeded_whatever_comes(sequence, name):
    control = controller(LAWS[name], limits=Limits(5.0, 800.0))
    state, before = control.init(Measurement(*sequence[0][:3])), 0.0
    for omega, v, age_s, slip, direction in sequence:
        state, torque, _ = control.step(state, SlipCommand(slip, direction), Measurement(omega, v, age_s), DT)
        assert abs(torque) <= 5.0
        assert abs(torque - before) <= 0.8 + 1e-9
        before = torque


def test_a_stale_speed_takes_the_torque_away_and_the_memory():
    control = controller(LAWS["pid"])
    x = Truth()
    state = control.init(measured(x))
    for _ in range(200):
        state, torque, _ = control.step(state, SlipCommand(0.12), measured(x), DT)
    assert torque > 2.0
    assert state.memory.integral_Nm > 1.0
    for _ in range(5):
        stale = Measurement(0.0, 0.0, age_s=0.11)
        state, torque, report = control.step(state, SlipCommand(0.12), stale, DT)
        assert int(report.flags) & ControlFlag.STALE
    assert torque == 0.0
    assert state.memory.integral_Nm == 0.0
    assert state.slip_target == 0.0


def test_the_integral_does_not_wind_up_at_the_limit():
    weak = Limits(1.0, 5000.0)
    for law in (LAWS["pid"], LAWS["sliding with integral"]):
        stuck, x = controller(law, limits=weak), Truth()
        state = stuck.init(measured(x))
        for _ in range(2000):
            state, torque, _ = stuck.step(state, SlipCommand(0.12), measured(x), DT)
        assert torque == 1.0
        spinning = Measurement(10.0, 0.5)
        for _ in range(5):
            state, torque, _ = stuck.step(state, SlipCommand(0.12), spinning, DT)
        assert torque < 0


def test_a_slip_that_the_ground_does_not_give_is_said():
    strong_ground = drive(controller(limits=Limits(2.0)), hold(0.5), DRY, 1.0)
    assert flagged(strong_ground, ControlFlag.UNREACHABLE)[-1]
    assert not any(flagged(drive(controller(), hold(0.5), SLIPPERY, 1.0), ControlFlag.UNREACHABLE))


@pytest.mark.parametrize("slip", [1.0, -1.5, math.nan])
def test_a_command_that_is_no_slip_is_said_and_gives_no_torque(slip):
    steps = drive(controller(), hold(slip), DRY, 0.1)
    assert all(flagged(steps, ControlFlag.BAD_COMMAND))
    assert {torque for _, torque, _ in steps} == {0.0}


@pytest.mark.parametrize("direction", [math.nan, math.inf, -math.inf])
def test_a_command_without_a_direction_is_reported_and_gives_no_torque(direction):
    steps = drive(controller(), hold(0.1, direction), DRY, 0.1)
    assert all(flagged(steps, ControlFlag.BAD_COMMAND))
    assert {torque for _, torque, _ in steps} == {0.0}


def test_wheels_are_independent():
    control = controller()
    state = control.init(Measurement(np.zeros(2), np.zeros(2)))
    both = Measurement(np.array([2.0, 9.0]), np.array([0.2, 1.0]))
    _, torques, _ = control.step(state, SlipCommand(0.12), both, DT)
    for i in (0, 1):
        alone = control.init(Measurement(0.0, 0.0))
        _, torque, _ = control.step(alone, SlipCommand(0.12), Measurement(both[0][i], both[1][i]), DT)
        assert torques[i] == torque


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_it_traces_and_the_compiled_step_is_the_same(law):
    control = controller(law)
    state = control.init(Measurement(0.0, 0.0))
    example = (state, SlipCommand(0.12, 1.0), Measurement(0.0, 0.0, 0.0, 0.0), DT)
    kernel = Kernel(control.step, *example)
    rng = np.random.default_rng(2)
    for _ in range(20):
        m = Measurement(rng.uniform(-5, 15), rng.uniform(0, 1), rng.uniform(0, 0.11), 0.0)
        command = SlipCommand(rng.uniform(-0.5, 0.5), 1.0)
        compiled = kernel(state, command, m, DT)
        state, torque, report = control.step(state, command, m, DT)
        assert compiled[1] == pytest.approx(torque, abs=1e-9)
        assert compiled[2] == pytest.approx(tuple(report), nan_ok=True)


def test_bad_settings_are_refused():
    with pytest.raises(InputError, match=r"slip_controller.unreachable_after_s must be > 0"):
        controller(unreachable_after_s=0.0)
