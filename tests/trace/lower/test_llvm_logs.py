"""`Kernel` with machine code: the same trees as with Python, whatever their shapes."""

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.trace import Kernel, kernel, tanh, where

pytest.importorskip("llvmlite")
RNG = np.random.default_rng(2)


def step(state, sample):
    (level, matrix, armed), (pull, on, vector) = state, sample
    level = 0.5 * level + where(on, pull, -pull) + vector[1]
    matrix = 0.9 * matrix + np.array([[level, 1.0], [tanh(level), vector[0]]])
    armed = on & (level > 0.0)
    return (level, matrix, armed), (matrix @ np.array([1.0, 2.0]), armed, level)


START = (0.1, np.eye(2), False)
SAMPLE = (0.0, False, np.zeros(2))
IN_PYTHON, IN_MACHINE_CODE = (Kernel(step, START, SAMPLE, lowering=name) for name in ("python", "machine"))


def samples(*shape):
    return RNG.standard_normal(shape), RNG.random(shape) < 0.5, RNG.standard_normal((shape[0], 2, *shape[1:]))


def assert_alike(found, wanted):
    assert type(found) is type(wanted)
    if isinstance(wanted, tuple):
        for f, w in zip(found, wanted, strict=True):
            assert_alike(f, w)
    else:
        assert np.shape(found) == np.shape(wanted)
        assert np.asarray(found).dtype == np.asarray(wanted).dtype
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12)


def test_one_log():
    log = samples(40)
    assert_alike(IN_MACHINE_CODE.scan(START, log), IN_PYTHON.scan(START, log))


def test_one_log_with_values_that_stay():
    pull, _, vector = samples(40)
    log = (pull, True, vector[0])
    assert_alike(IN_MACHINE_CODE.scan(START, log), IN_PYTHON.scan(START, log))


def test_columns_that_are_not_side_by_side():
    pull, on, vector = samples(80)
    log = (pull[::2], on[::2], vector[::2])
    assert_alike(IN_MACHINE_CODE.scan(START, log), IN_PYTHON.scan(START, log))


@pytest.mark.parametrize("lanes", [1, 5, 16, 21])
def test_many_logs(lanes):
    logs = samples(30, lanes)
    assert_alike(IN_MACHINE_CODE.scan_lanes(START, logs), IN_PYTHON.scan_lanes(START, logs))


def test_many_logs_that_share_a_column_or_come_transposed():
    pull, _, vector = samples(30, 9)
    logs = (np.asfortranarray(pull), RNG.random(30) < 0.5, vector)
    assert_alike(IN_MACHINE_CODE.scan_lanes(START, logs), IN_PYTHON.scan_lanes(START, logs))


@pytest.mark.parametrize("lengths", [(100,), (60, 40)])
def test_auto_takes_machine_code_once_the_logs_of_a_kernel_pay_for_it(monkeypatch, lengths):
    monkeypatch.setattr(kernel, "WORTH_STEPS", sum(lengths))
    automatic = Kernel(step, START, SAMPLE, lowering="auto")
    for length in (*lengths[:-1], lengths[-1] - 1):
        assert_alike(automatic.scan(START, log := samples(length)), IN_PYTHON.scan(START, log))
    assert "machine" not in vars(automatic)
    assert_alike(automatic.scan(START, log := samples(1)), IN_PYTHON.scan(START, log))
    assert "machine" in vars(automatic)


def test_auto_takes_machine_code_for_many_lanes(monkeypatch):
    monkeypatch.setattr(kernel, "WORTH_LANE_STEPS", 90)
    automatic = Kernel(step, START, SAMPLE, lowering="auto")
    automatic.scan_lanes(START, samples(10, 8))
    assert "machine" not in vars(automatic)
    assert_alike(automatic.scan_lanes(START, log := samples(10, 9)), IN_PYTHON.scan_lanes(START, log))
    assert "machine" in vars(automatic)


def test_the_environment_chooses_and_a_wrong_word_is_refused(monkeypatch):
    monkeypatch.setenv("OHMWARD_LOWERING", "python")
    assert Kernel(step, START, SAMPLE).lowering == "python"
    with pytest.raises(InputError, match="lowering must be one of auto, python, machine, got 'gpu'"):
        Kernel(step, START, SAMPLE, lowering="gpu")


def test_live_samples_are_the_whole_log():
    log = samples(20)
    (state, outputs), lives = IN_PYTHON.scan(START, log), [k.live(START) for k in (IN_PYTHON, IN_MACHINE_CODE)]
    for k in range(20):
        for live in lives:
            found = live.step((float(log[0][k]), bool(log[1][k]), log[2][k]))
            assert_alike(found, (outputs[0][k], bool(outputs[1][k]), float(outputs[2][k])))
    for live in lives:
        assert_alike(live.state, state)


def test_a_live_state_can_be_set():
    for k in (IN_PYTHON, IN_MACHINE_CODE):
        live = k.live(START)
        first = live.step(SAMPLE)
        live.state = START
        assert_alike(live.step(SAMPLE), first)


def test_tracing_again_gives_the_same_text_so_the_cache_finds_it():
    sources = {Kernel(step, START, SAMPLE).source("llvm") for _ in range(3)}
    assert len(sources) == 1
