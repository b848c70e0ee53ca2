"""Every filter traced: the same results as with floats, and programs of the size that they should have."""

import time
from functools import partial

import numpy as np
import pytest

from filters import saft_seven_states
from filters.examples import PENDULUM, PENDULUM_Q, PENDULUM_R, height, pendulum, two_outputs
from ohmward.filters import (
    Belief,
    adaptive,
    extended,
    gate,
    is_healthy,
    kalman,
    log_likelihood,
    nis,
    pack,
    unpack,
    unscented,
)
from ohmward.filters.adaptive import Matching
from ohmward.trace import Kernel, trace
from ohmward_lab.published import scheme_by_method

F = np.array([[1.0, 0.1, 0.0], [-0.1, 0.9, 0.0], [0.0, 0.0, 1.0]])
H = np.array([[1.0, 0.0, 0.5]])
TWO_R = np.array([[0.01, 0.002], [0.002, 0.03]])
MATCHING = Matching(PENDULUM_Q, PENDULUM_R / 10, window=20)
SEVEN = saft_seven_states.PACKED


def kalman_step(belief, y):
    return kalman.update(kalman.predict(belief, F, PENDULUM_Q), y, H, PENDULUM_R)


def extended_step(belief, y):
    return extended.update(extended.predict(belief, pendulum, PENDULUM_Q), y, height, PENDULUM_R)


def iterated_step(belief, y):
    return extended.update(extended.predict(belief, pendulum, PENDULUM_Q), y, height, PENDULUM_R, iterations=3)


def two_output_step(belief, y):
    return extended.update(extended.predict(belief, pendulum, PENDULUM_Q), y, two_outputs, TWO_R)


def unscented_step(belief, y):
    return unscented.update(unscented.predict(belief, pendulum, PENDULUM_Q), y, height, PENDULUM_R)


def unscented_two_output_step(belief, y):
    return unscented.update(unscented.predict(belief, pendulum, PENDULUM_Q), y, two_outputs, TWO_R)


def reusing_step(belief, y):
    return unscented.step_reusing_points(belief, pendulum, height, y, PENDULUM_Q, PENDULUM_R)


def sequential_step(belief, y):
    belief = unscented.predict(belief, pendulum, PENDULUM_Q)
    belief, _ = unscented.update(belief, y[:1], lambda x: two_outputs(x)[:1], np.array([[0.01]]))
    return unscented.update(belief, y[1:], lambda x: two_outputs(x)[1:], np.array([[0.03]]))


def one_output(rng):
    return 0.3 + 0.1 * rng.normal(size=1)


def two(rng):
    return 0.3 + 0.1 * rng.normal(size=2)


def with_packed_belief(step):
    """The step on a packed belief, reporting everything that can be said about the innovation."""

    def packed_step(packed, y):
        belief, innovation = step(unpack(packed), y)
        return pack(belief), (*innovation, nis(innovation), log_likelihood(innovation), is_healthy(belief))

    return packed_step


@pytest.mark.parametrize(
    ("step", "measure"),
    [
        (kalman_step, one_output),
        (extended_step, one_output),
        (iterated_step, one_output),
        (two_output_step, two),
        (unscented_step, one_output),
        (unscented_two_output_step, two),
        (reusing_step, one_output),
        (sequential_step, two),
    ],
)
def test_traced_is_with_floats(step, measure):
    step, rng = with_packed_belief(step), np.random.default_rng(1)
    state = traced_state = pack(PENDULUM)
    kernel = Kernel(step, state, measure(rng))
    for _ in range(30):
        y = measure(rng)
        state, output = step(state, y)
        traced_state, traced_output = kernel(traced_state, y)
        assert_close((traced_state, traced_output), (state, output))
    assert output[-1] == 1


@pytest.mark.parametrize("y", [0.3, np.nan, 1e3])
@pytest.mark.parametrize(
    "step", [adaptive.extended_step, adaptive.unscented_step, adaptive.unscented_step_reusing_points]
)
def test_traced_adaptive_steps_are_those_with_floats(step, y):
    matching = Matching(PENDULUM_Q, PENDULUM_R / 10, window=20, gate=9.0)

    def packed_step(packed, y):
        state, innovation = step(scheme_by_method.unpack(packed), pendulum, height, y, matching)
        return scheme_by_method.pack(state), innovation.value

    state = traced_state = scheme_by_method.pack(adaptive.init(PENDULUM, PENDULUM_Q, PENDULUM_R))
    kernel = Kernel(packed_step, state, np.zeros(1))
    for value in (0.3, 0.25, y, 0.28):
        state, output = packed_step(state, np.array([value]))
        traced_state, traced_output = kernel(traced_state, np.array([value]))
        assert_close((traced_state, traced_output), (state, output))
    assert state.samples == (4 if y == 0.3 else 3)


def test_traced_gate_is_that_with_floats():
    def step(packed, y):
        prior = unscented.predict(unpack(packed), pendulum, PENDULUM_Q)
        posterior, innovation = unscented.update(prior, y, height, PENDULUM_R)
        passes = gate.passes(innovation, 9.0)
        return pack(gate.choose(passes, posterior, prior)), gate.choose(passes, 1.0, 0.0)

    state = pack(PENDULUM)
    y = np.array([[0.3], [np.nan], [50.0], [0.2]])
    with_floats = state
    for value in y:
        with_floats, _ = step(with_floats, value)
    final, used = Kernel(step, state, y[0]).scan(state, y)
    assert_close(final, with_floats)
    assert used.tolist() == [1.0, 0.0, 0.0, 1.0]


def assert_close(a, b):
    """Equal to 1e-12 through nested tuples, nan equal to nan."""
    if isinstance(b, tuple):
        for x, y in zip(a, b, strict=True):
            assert_close(x, y)
    else:
        np.testing.assert_allclose(np.asarray(a, dtype=float), np.asarray(b, dtype=float), rtol=1e-12, atol=1e-12)


def count(filter_step):
    step = partial(saft_seven_states.packed_step, filter_step=filter_step)
    return sum(trace(step, SEVEN, (0.0, 0.0)).operations.values())


@pytest.mark.parametrize(
    ("filter_step", "most"),
    [
        (adaptive.unscented_step_reusing_points, 1150),
        (adaptive.unscented_step, 1650),
        (adaptive.extended_step, 500),
    ],
)
def test_the_seven_state_adaptive_filter_stays_small(filter_step, most):
    assert 0.9 * most < count(filter_step) <= most


def test_parameter_states_save_a_third_of_the_operations_and_change_nothing(monkeypatch):
    step = saft_seven_states.packed_step
    current_A, voltage_V = saft_seven_states.simulated_log(100)
    seen = Kernel(step, SEVEN, (0.0, 0.0))
    monkeypatch.setattr(unscented, "_same", lambda a, b: False)
    unseen = Kernel(step, SEVEN, (0.0, 0.0))
    assert count(adaptive.unscented_step_reusing_points) > 1.5 * sum(seen.program.operations.values())
    assert_close(seen.scan(SEVEN, (current_A, voltage_V)), unseen.scan(SEVEN, (current_A, voltage_V)))


def test_the_seven_state_filter_follows_voltage_and_parameters():
    step = saft_seven_states.packed_step
    current_A, voltage_V = saft_seven_states.simulated_log(3000)
    state, (_, innovation_V) = Kernel(step, SEVEN, (0.0, 0.0)).scan(SEVEN, (current_A, voltage_V))
    belief = scheme_by_method.unpack(state).belief
    error = belief.mean[3:] - saft_seven_states.TRUE_PARAMETERS
    assert np.std(innovation_V[500:]) < 1.25 * saft_seven_states.NOISE_STD_V
    assert np.abs(error / np.sqrt(np.diag(belief.cov)[3:])).max() < 3
    assert np.sqrt(np.diag(belief.cov)[3:]).max() < 0.2
    assert state.R[0] == pytest.approx(saft_seven_states.NOISE_STD_V**2, rel=0.5)


def shortest_s(work, repeat=5):
    """Shortest processor time of a few runs [s]."""
    times = []
    for _ in range(repeat):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


@pytest.mark.slow
def test_a_compiled_step_is_several_times_faster_than_numpy_and_lanes_than_one():
    """In the same run, since a time judges the machine."""
    current_A, voltage_V = saft_seven_states.simulated_log(2000)
    lanes = [np.repeat(column[:50, None], 1024, axis=1) for column in (current_A, voltage_V)]

    def in_numpy():
        state = SEVEN
        for sample in zip(current_A[:100], voltage_V[:100], strict=True):
            state, _ = saft_seven_states.packed_step(state, sample)

    def compiled_anew():
        fresh = Kernel(saft_seven_states.packed_step, SEVEN, (0.0, 0.0), lowering="python")
        fresh.scan(SEVEN, (current_A[:1], voltage_V[:1]))
        return fresh

    kernel = compiled_anew()
    numpy_s = shortest_s(in_numpy) / 100
    one_s = shortest_s(lambda: kernel.scan(SEVEN, (current_A, voltage_V))) / 2000
    lane_s = shortest_s(lambda: kernel.scan_lanes(SEVEN, tuple(lanes))) / (50 * 1024)
    assert one_s < numpy_s / 4
    assert lane_s < one_s / 4
    assert shortest_s(compiled_anew, 3) < 500 * numpy_s


def test_one_output_costs_one_division_and_no_root():
    program = trace(lambda packed, y: kalman_step(unpack(packed), y)[0].mean, pack(PENDULUM), np.zeros(1))
    assert program.operations["divide"] == 1
    assert program.operations["sqrt"] == 0


def test_a_state_that_only_drifts_costs_the_extended_filter_nothing_to_predict():
    def parameters_only(packed):
        return pack(extended.predict(unpack(packed), lambda x: x, np.zeros((3, 3))))

    assert trace(parameters_only, pack(Belief(PENDULUM.mean, PENDULUM.cov))).operations.total() == 0
