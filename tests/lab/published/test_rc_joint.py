"""The joint filter: it finds the parameters, its sigma covers them, and nothing that a sensor sends stops it."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from battery.examples import row, scan
from kernels import kernel_of
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.errors import InputError
from ohmward.filters import consistency, kalman
from ohmward.filters.belief import Belief, PackedBelief, pack, unpack
from ohmward_lab.published import rc
from ohmward_lab.published.rc_circuit import next_state_with_voltage
from ohmward_lab.published.rc_joint import PARAMETERS, STATES, Nominal, RcJoint
from published.rc_examples import EVEN, lanes, simulate

TRUE = Nominal(EVEN.c_bulk_F, EVEN.c_surface_F, EVEN.r_bulk_ohm, EVEN.r_terminal_ohm)
WRONG = Nominal(1.8 * TRUE.c_bulk_F, 0.5 * TRUE.c_surface_F, 1.6 * TRUE.r_ohm, 0.5 * TRUE.r_terminal_ohm)
JOINT = RcJoint(WRONG)
#: No noise but that of the sensors: no random walk, no disturbance of the voltage, and none is learnt.
LINEAR: dict[str, Any] = {"parameter_walk": 0.0, "disturbance_V": 0.0, "match_Q": False, "match_R": False, "gate": 1e9}
NAN = math.nan
RUNS, LENGTH = 24, 1200
SENSORS = {"voltage_std_V": 0.002, "current_std_A": 0.02}


@pytest.fixture(scope="module")
def runs():
    return [simulate(EVEN, LENGTH, seed, **SENSORS) for seed in range(RUNS)]


def scanned(joint, samples):
    """State at the end and estimates (T,) of one log."""
    return scan(joint, samples, state=joint.init(row(samples, 0)))


@pytest.fixture(scope="module")
def found(runs):
    """State at the end and estimates (T, B) of all runs."""
    first = row(runs[0].samples, 0)
    start = JOINT.init(first)
    return kernel_of(JOINT, start, first).scan_lanes(start, lanes(runs))


def true_state(nominal, run):
    """The six elements of the state at the end of a run that a simulation knows."""
    circuit = [
        math.log(TRUE.c_bulk_F / nominal.c_bulk_F),
        math.log(TRUE.c_surface_F / nominal.c_surface_F),
        math.log(TRUE.r_ohm / nominal.r_ohm),
        math.log(TRUE.r_terminal_ohm / nominal.r_terminal_ohm),
    ]
    return np.array([*circuit, *run.states[-1]])


def nees(nominal, end, runs):
    """Normalised error squared of the six elements, (B,)."""
    values = []
    for b, run in enumerate(runs):
        mean, cov = unpack(PackedBelief(end.belief.mean[:, b], end.belief.lower[:, b]))
        error = true_state(nominal, run) - mean[:6]
        values.append(error @ np.linalg.solve(cov[:6, :6], error))
    return np.array(values)


def test_finds_the_parameters_from_a_wrong_start(found):
    _, estimates = found
    for name, true in zip(rc.Circuit._fields, EVEN, strict=True):
        at_end = getattr(estimates.circuit, name)[-1] / true
        assert np.abs(at_end - 1).mean() < 0.03, name
    assert not np.any(estimates.flags[100:])


def test_sigma_covers_the_error(found, runs):
    """The floors make it cautious: the NEES of six elements stays below 6, but it is not a tenth of it."""
    end, _ = found
    assert 0.6 < nees(WRONG, end, runs).mean() < 6.0


def test_sigma_is_exact_when_the_noise_is_known_and_the_start_is_near():
    """Truth drawn from the filter's own prior, no matching: the mean NEES of the parameters is inside its bounds.

    Near, because a filter that linearises and has no process noise grows too sure from a far start; hence the floors.
    Of the parameters, because without process noise they and the current determine V_cs - V_cb.
    """
    spread, rng = 0.01, np.random.default_rng(5)
    joint = RcJoint(TRUE, (spread,) * 4, current_std_A=0.0, **LINEAR)
    values = []
    for seed in range(40):
        logs = spread * rng.standard_normal(4)
        r_ohm, r_terminal_ohm = TRUE.r_ohm * np.exp(logs[2]), TRUE.r_terminal_ohm * np.exp(logs[3])
        drawn = TRUE.c_bulk_F * np.exp(logs[0]), TRUE.c_surface_F * np.exp(logs[1]), r_ohm, r_ohm, r_terminal_ohm
        run = simulate(rc.Circuit(*drawn), 400, seed, voltage_std_V=0.002)
        level_V = float(run.states[0, 0] + spread * rng.standard_normal())
        end, _ = scan(joint, run.samples, state=joint.init(row(run.samples, 0), bulk_V=level_V, bulk_std_V=spread))
        mean, cov = unpack(end.belief)
        values.append(consistency.nees(Belief(mean[:PARAMETERS], cov[:PARAMETERS, :PARAMETERS]), logs))
    low, high = consistency.mean_bounds(PARAMETERS, len(values), 0.999)
    assert low < np.mean(values) < high


def test_known_parameters_leave_the_linear_kalman_filter(runs):
    """Without doubt about the parameters the voltages [V_cb, V_cs, V] are a linear model."""
    joint = RcJoint(TRUE, (0.0,) * 4, **LINEAR)
    samples = runs[0].samples
    state = joint.init(row(samples, 0))
    belief = Belief(*(part[PARAMETERS:] for part in unpack(state.belief)))
    belief = Belief(belief.mean, belief.cov[:, PARAMETERS:])
    per_V = np.array([1 / (TRUE.c_bulk_F + TRUE.c_surface_F), 0.5 / TRUE.c_surface_F, 0.0])
    H, R = np.array([[0.0, 0.0, 1.0]]), np.array([[joint.voltage_std_V**2]])
    before_A = 0.0
    for k in range(200):
        sample = row(samples, k)
        state, _ = joint.step(state, sample)
        F = np.column_stack([next_state_with_voltage(e, 0.0, 0.0, 0.0, EVEN, sample.dt_s) for e in np.eye(3)])
        Q = np.diag(per_V**2 * joint.current_std_A**2 * sample.dt_s)
        currents = before_A, 0.5 * (before_A + sample.current_A), sample.current_A
        belief = kalman.predict(belief, F, Q, next_state_with_voltage(np.zeros(3), *currents, EVEN, sample.dt_s))
        before_A = sample.current_A
        # Sigma points are reused: the output's spread is that of the state before this step's process noise.
        without = belief.cov - Q
        S = H @ without @ H.T + R
        K = without @ H.T / S[0, 0]
        y = np.array([sample.voltage_V])
        belief = Belief(belief.mean + K @ (y - H @ belief.mean), belief.cov - K @ S @ K.T)
    mean, cov = unpack(state.belief)
    np.testing.assert_allclose(mean[PARAMETERS:], belief.mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(cov[PARAMETERS:, PARAMETERS:], belief.cov, rtol=1e-6, atol=1e-15)


def test_follows_a_battery_that_warms_up_and_would_not_without_floors():
    """The resistances lose a third in an hour; without random walk the filter is sure and wrong."""
    run = simulate(EVEN, 3600, 1, voltage_std_V=0.002, warming=1 / 3)
    walking = RcJoint(TRUE, parameter_walk=0.3)
    stiff = replace(walking, parameter_walk=0.0, match_Q=False, disturbance_V=1e-5, current_std_A=0.001)

    def error_and_std(joint):
        end, _ = scanned(joint, run.samples)
        mean, cov = unpack(end.belief)
        return mean[2] - math.log(2 / 3), math.sqrt(cov[2, 2])

    error, std = error_and_std(walking)
    assert abs(error) < min(0.1, 3 * std)
    error, std = error_and_std(stiff)
    assert abs(error) > 5 * std


def test_traced_step_is_the_step(runs):
    samples = SocSample(*(c[:60] for c in runs[0].samples))
    state = JOINT.init(row(samples, 0))
    for k in range(60):
        state, _ = JOINT.step(state, row(samples, k))
    end, _ = scanned(JOINT, samples)
    np.testing.assert_allclose(end.belief.mean, state.belief.mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(end.belief.lower, state.belief.lower, rtol=1e-6, atol=1e-12)


def test_lanes_are_scans(found, runs):
    end, _ = found
    for b, run in enumerate(runs[:2]):
        alone, _ = scan(JOINT, run.samples, state=JOINT.init(row(runs[0].samples, 0)))
        np.testing.assert_allclose(end.belief.mean[:, b], alone.belief.mean, rtol=0, atol=1e-8)


FAULTS = {
    "no voltage": ({"voltage_V": NAN}, SocFlag.NO_VOLTAGE),
    "infinite voltage": ({"voltage_V": math.inf}, SocFlag.NO_VOLTAGE),
    "no current": ({"current_A": NAN}, SocFlag.NO_CURRENT),
    "no time": ({"dt_s": NAN}, SocFlag.BAD_TIME),
    "time backwards": ({"dt_s": -5.0}, SocFlag.BAD_TIME),
    "gap": ({"dt_s": 4000.0, "voltage_V": NAN}, SocFlag.GAP | SocFlag.NO_VOLTAGE),
    "voltage spike": ({"voltage_V": 40.0}, SocFlag.VOLTAGE_REJECTED),
    "voltage wire off": ({"voltage_V": 0.0}, SocFlag.NO_VOLTAGE),
    "nothing": (
        {"dt_s": NAN, "current_A": NAN, "voltage_V": NAN},
        SocFlag.BAD_TIME | SocFlag.NO_CURRENT | SocFlag.NO_VOLTAGE,
    ),
    "repeated": ({"dt_s": 0.0}, SocFlag(0)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_flagged_and_survived(fault, runs):
    changes, flag = FAULTS[fault]
    samples = SocSample(*(c.copy() for c in runs[0].samples))
    for name, value in changes.items():
        getattr(samples, name)[705] = value
    _, found = scanned(JOINT, samples)
    assert found.flags[705] == float(flag)
    assert np.count_nonzero(found.flags[100:]) == (1 if flag else 0)
    for name, true in zip(rc.Circuit._fields, EVEN, strict=True):
        assert getattr(found.circuit, name)[-1] == pytest.approx(true, rel=0.1), name
    assert np.isfinite(found.voltage_V).all()


def test_repeated_sample_teaches_nothing(runs):
    state, _ = scanned(JOINT, SocSample(*(c[:300] for c in runs[0].samples)))
    again, _ = JOINT.step(state, row(runs[0].samples, 299)._replace(dt_s=0.0))
    np.testing.assert_allclose(again.belief.mean, state.belief.mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(again.belief.lower, state.belief.lower, rtol=1e-6, atol=1e-12)


def test_lost_belief_starts_again(runs):
    samples = runs[0].samples
    state, _ = scanned(JOINT, SocSample(*(c[:200] for c in samples)))
    broken = Belief(np.full(STATES, np.nan), np.full((STATES, STATES), np.nan))
    state, estimate = JOINT.step(state._replace(belief=pack(broken)), row(samples, 200))
    assert estimate.flags == SocFlag.NOT_POSITIVE_DEFINITE
    _, found = scan(JOINT, SocSample(*(c[201:] for c in samples)), state=state)
    assert found.circuit.r_terminal_ohm[-1] == pytest.approx(EVEN.r_terminal_ohm, rel=0.2)


def test_patience_ends_when_it_is_the_filter_that_is_wrong(runs):
    """Another battery in the middle of a log: rejected for a minute, then believed."""
    samples = SocSample(*(c.copy() for c in runs[0].samples))
    samples.voltage_V[700:] += 0.5
    _, found = scanned(JOINT, samples)
    rejected = (found.flags.astype(int) & SocFlag.VOLTAGE_REJECTED) > 0
    assert rejected[700:760].all()
    assert not rejected[800:].any()


def test_first_voltage_may_be_missing_where_the_level_is_given():
    with pytest.raises(InputError, match="first sample has no voltage: give bulk_V"):
        JOINT.init(SocSample(0.0, 0.0, NAN, NAN))
    assert JOINT.init(SocSample(0.0, 0.0, NAN, NAN), bulk_V=12.5).belief.mean[-1] == 12.5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"nominal": WRONG._replace(r_ohm=0.0)}, r"nominal\.r_ohm must be > 0, got 0"),
        ({"voltage_std_V": 0.0}, "voltage_std_V must be > 0, got 0"),
        ({"parameter_walk": -1.0}, "parameter_walk must be >= 0, got -1"),
        ({"window": 0.5}, "window must be at least 1 sample, got 0.5"),
    ],
)
def test_bad_settings_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(JOINT, **change)


def test_a_step_takes_as_few_operations_as_before(runs):
    first = row(runs[0].samples, 0)
    assert 1500 < kernel_of(JOINT, JOINT.init(first), first).program.operations.total() < 1700
