import math

import numpy as np
import pytest

from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.sample import SocSample
from ohmward.errors import InputError
from ohmward.filters.belief import unpack
from ohmward.logs.log import Log
from ohmward_lab.published import rc, rc_circuit
from ohmward_lab.published.rc_three_states import RcThreeStates

CIRCUIT = rc.Circuit(9000.0, 40.0, 0.09, 0.06, 0.05)
OCV = OcvCurve((11.5, 13.5))
MODEL = rc.RcModel(*CIRCUIT, OCV, 9040.0 * 2.0 / 3600.0)


def log_of(model, start_soc):
    """Ten minutes of the circuit itself, with a current that steps."""
    rng = np.random.default_rng(1)
    time_s = np.arange(600.0)
    current_A = -np.repeat(rng.uniform(0.0, 3.0, 60), 10)
    current_A[:10] = 0.0
    x, voltage_V = rc_circuit.at_rest(model, start_soc), []
    for k, now_A in enumerate(current_A):
        if k:
            x = rc_circuit.next_state(x, 0.5 * (now_A + current_A[k - 1]), model, 1.0)
        voltage_V.append(rc_circuit.voltage(x, now_A, model)[0])
    return Log("circuit", time_s, current_A, np.array(voltage_V)), x


def test_on_its_own_circuit_the_filter_that_jumps_has_no_innovation():
    log, _ = log_of(MODEL, 0.8)
    found = SocEstimator(RcThreeStates(MODEL, jumps=True), initial_soc=0.8).run(log)
    assert np.abs(found.innovation_V[1:]).max() < 1e-6


def test_without_the_jump_each_step_of_the_current_is_an_innovation_of_its_ohmic_drop():
    log, _ = log_of(MODEL, 0.8)
    found = SocEstimator(RcThreeStates(MODEL, jumps=False), initial_soc=0.8).run(log)
    steps = np.diff(log.current_A)
    largest = int(np.argmax(np.abs(steps)))
    drop_V = 0.5 * rc.instant_resistance(MODEL) * steps[largest]  # the other half comes by the mean current
    assert abs(found.innovation_V[largest + 1]) > 0.5 * abs(drop_V)


def test_a_wrong_start_is_taken_as_given():
    log, _ = log_of(MODEL, 0.8)
    filter_ = RcThreeStates(MODEL)
    first = SocSample(0.0, float(log.current_A[0]), float(log.voltage_V[0]), math.nan)
    belief = unpack(filter_.init(first, soc=0.5).belief)
    assert belief.mean == pytest.approx([12.5, 12.5, 12.5])


def test_no_voltage_is_no_correction():
    filter_ = RcThreeStates(MODEL)
    state = filter_.init(SocSample(0.0, 0.0, 12.9, math.nan), 0.8)
    after, estimate = filter_.step(state, SocSample(1.0, 0.0, math.nan, math.nan))
    assert math.isnan(float(estimate.innovation_V))
    assert float(estimate.soc) == pytest.approx(0.8, abs=1e-3)
    assert np.isfinite(unpack(after.belief).mean).all()


def test_a_noise_of_nothing_is_refused():
    with pytest.raises(InputError, match="voltage_variance_V2 must be"):
        RcThreeStates(MODEL, voltage_variance_V2=0.0)
