"""The joint filter as published: its step is [T]'s and a jump, it finds the circuit, and no sample stops it."""

import math
from functools import partial

import numpy as np
import pytest

from battery.examples import row, scan
from ohmward.battery.soc.sample import SocSample
from ohmward.errors import InputError
from ohmward.filters import adaptive
from ohmward.filters.belief import unpack
from ohmward.trace import trace
from ohmward_lab.published import rc, rc_circuit
from ohmward_lab.published.rc import Nominal
from ohmward_lab.published.textbook_joint import LEAST, TextbookJoint
from published.rc_examples import EVEN, drive, rates_with_voltage, simulate

TRUE = Nominal(EVEN.c_bulk_F, EVEN.c_surface_F, EVEN.r_bulk_ohm, EVEN.r_terminal_ohm)
JOINT = TextbookJoint(Nominal(1.3 * TRUE.c_bulk_F, 0.8 * TRUE.c_surface_F, 1.2 * TRUE.r_ohm, 0.8 * TRUE.r_terminal_ohm))
NAN = math.nan
EXAMPLE = SocSample(0.0, 0.0, 0.0, 0.0)


def circuit_of(nominal, z):
    """The elements that the first four states say."""
    r = nominal.r_ohm / z[2]
    r_terminal = z[3] * (nominal.r_terminal_ohm + 0.5 * nominal.r_ohm) - 0.5 * r
    return rc.Circuit(nominal.c_bulk_F / z[0], nominal.c_surface_F / z[1], r, r, r_terminal)


def simulated(count=3000, voltage_std_V=0.002, seed=0):
    """A log of a battery that is what the filter thinks: Euler steps, and a voltage that jumps with the current."""
    rng = np.random.default_rng(seed)
    current_A = drive(rng, count, hold=40)
    mean_A = 0.5 * (current_A + np.concatenate([current_A[:1], current_A[:-1]]))
    A, B = rates_with_voltage(EVEN)
    instant_ohm = rc.instant_resistance(EVEN)
    states = np.full((count, 3), 12.5)
    for k in range(1, count):
        before = states[k - 1] + [0.0, 0.0, instant_ohm * (mean_A[k] - current_A[k - 1])]
        states[k] = before + A @ before + B * mean_A[k] + [0.0, 0.0, instant_ohm * (current_A[k] - mean_A[k])]
    voltage_V = states[:, 2] + voltage_std_V * rng.standard_normal(count)
    return SocSample(np.ones(count), current_A, voltage_V, np.full(count, NAN)), states


def rows(samples):
    return [SocSample(*map(float, row)) for row in zip(*samples, strict=True)]


def run(joint, samples, lowering="python"):
    return scan(joint, samples, state=joint.init(row(samples, 0)), lowering=lowering)


def test_the_model_is_an_euler_step_of_the_circuit():
    z, voltages = np.array([1.1, 0.7, 1.3, 0.9]), np.array([12.1, 12.0, 11.7])
    A, B = rates_with_voltage(circuit_of(JOINT.nominal, z))
    after = JOINT.next_state(np.array([*z, *voltages]), -3.0, -3.0, 0.5)
    np.testing.assert_allclose(after, [*z, *(voltages + 0.5 * (A @ voltages + B * -3.0))], rtol=0, atol=1e-13)


def test_the_voltage_jumps_with_the_current():
    """The change of the current times R_t + R_e / 2 at once, for every change and in no time."""
    z, voltages = np.array([1.1, 0.7, 1.3, 0.9]), np.array([12.1, 12.0, 11.7])
    before_A, now_A = -3.0, 5.0
    after = JOINT.next_state(np.array([*z, *voltages]), 0.5 * (before_A + now_A), now_A, 0.0)
    jump_V = rc.instant_resistance(circuit_of(JOINT.nominal, z)) * (now_A - before_A)
    np.testing.assert_allclose(after, [*z, *voltages[:2], voltages[2] + jump_V], rtol=0, atol=1e-13)


def test_the_step_of_the_voltage_approaches_the_exact_one():
    """Half the step, a quarter of the error, for a disturbance and a jump at once."""
    z, x = np.array([1.0, 1.0, 1.0, 1.0]), np.array([12.1, 12.0, 11.7])
    p = circuit_of(JOINT.nominal, z)
    errors = []
    for dt_s in (0.2, 0.1):
        exact = rc_circuit.next_state_with_voltage(x, -3.0, 1.0, 5.0, p, dt_s)
        errors.append(np.abs(JOINT.next_state(np.array([*z, *x]), 1.0, 5.0, dt_s)[4:] - exact))
    np.testing.assert_allclose(errors[1], 0.25 * errors[0], rtol=0.02)


def test_the_filter_is_the_generic_one():
    """The same numbers as `filters.adaptive` with its own order of matching: Q and R of a step are the last step's."""
    samples, _ = simulated(60)
    state = JOINT.init(rows(samples)[0])
    Q_floor = np.diag(np.square(JOINT.walk))
    R_floor = np.array([[JOINT.voltage_std_V**2]])
    matching = adaptive.Matching(Q_floor, R_floor, JOINT.window)
    belief = unpack(state.belief)
    generic = adaptive.init(belief, Q_floor, R_floor + belief.cov[-1:, -1:])
    before_A = samples.current_A[0]
    for sample in rows(samples):
        mean_A, before_A = 0.5 * (before_A + sample.current_A), sample.current_A
        generic, innovation = adaptive.unscented_step_reusing_points(
            generic,
            partial(JOINT.next_state, mean_A=mean_A, now_A=sample.current_A, dt_s=1.0),
            lambda x: x[-1:],
            np.array([sample.voltage_V]),
            matching,
        )
        state, estimate = JOINT.step(state, sample)
        np.testing.assert_allclose(estimate.innovation_V, innovation.value[0], rtol=0, atol=1e-12)
    ours = unpack(state.belief)
    np.testing.assert_allclose(ours.mean, generic.belief.mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours.cov, generic.belief.cov, rtol=0, atol=1e-12)


def test_it_finds_the_circuit_of_its_own_model():
    samples, states = simulated(20_000)
    _, found = run(JOINT, samples)
    assert found.r_terminal_ohm[-1] == pytest.approx(TRUE.r_terminal_ohm, rel=0.1)
    assert found.r_ohm[-1] == pytest.approx(TRUE.r_ohm, rel=0.1)
    assert found.c_surface_F[-1] == pytest.approx(TRUE.c_surface_F, rel=0.1)
    assert np.abs(found.bulk_V[-1] - states[-1, 0]) < 0.02


RATES = pytest.mark.parametrize(("dt_s", "count"), [(0.1, 12_000), (1.0, 3000)], ids=["10 Hz", "1 Hz"])


@RATES
def test_it_keeps_the_circuit_that_it_starts_from(dt_s, count):
    """The exact circuit, jumps of the current every 20 samples, the right start: R_e and C_s stay, at every sample."""
    samples = simulate(EVEN, count, 1, dt_s=dt_s).samples
    _, found = run(TextbookJoint(TRUE, start_std=0.1), samples)
    for name in ("r_ohm", "c_surface_F", "r_terminal_ohm"):
        np.testing.assert_allclose(getattr(found, name), getattr(TRUE, name), rtol=0.05, err_msg=name)


@RATES
def test_it_comes_back_to_the_circuit_that_it_starts_from(dt_s, count):
    """As above with 2 mV of noise and a start that is believed within 30 %: right again within 300 s."""
    samples = simulate(EVEN, count, 1, dt_s=dt_s, voltage_std_V=0.002).samples
    _, found = run(TextbookJoint(TRUE), samples)
    settled = slice(int(300 / dt_s), None)
    for name in ("r_ohm", "c_surface_F", "r_terminal_ohm"):
        np.testing.assert_allclose(getattr(found, name)[settled], getattr(TRUE, name), rtol=0.05, err_msg=name)


@pytest.mark.parametrize("share", [(1.3, 0.7, 1.3, 0.7), (0.7, 1.3, 0.7, 1.3), (1.3, 1.3, 1.3, 1.3)])
def test_it_converges_from_a_start_that_is_30_percent_wrong(share):
    """Within 1000 s to 5 %; an Euler step makes C_s too large by 2.8 % of that."""
    samples = simulate(EVEN, 3000, 2, voltage_std_V=0.002).samples
    _, found = run(TextbookJoint(Nominal(*(s * value for s, value in zip(share, TRUE, strict=True)))), samples)
    for name in ("r_ohm", "c_surface_F", "r_terminal_ohm"):
        np.testing.assert_allclose(getattr(found, name)[1000:], getattr(TRUE, name), rtol=0.05, err_msg=name)
    assert found.c_bulk_F[-1] == pytest.approx(TRUE.c_bulk_F, rel=0.02)


def test_bad_samples_change_nothing_and_stop_nothing():
    samples, _ = simulated(400)
    bad = [c.copy() for c in samples]
    bad[1][50], bad[2][60], bad[2][70], bad[0][80], bad[0][90] = NAN, NAN, math.inf, -1.0, NAN
    after, found = run(JOINT, SocSample(*bad))
    assert np.isfinite(after.belief.mean).all()
    assert np.isfinite(after.belief.lower).all()
    assert np.isnan(found.innovation_V).sum() == 2
    good, _ = run(JOINT, samples)
    np.testing.assert_allclose(after.belief.mean[4:], good.belief.mean[4:], atol=0.02)


def test_a_missing_voltage_leaves_the_noise_as_it_was():
    state = JOINT.init(SocSample(0.0, -1.0, 12.5, NAN))
    state, _ = JOINT.step(state, SocSample(1.0, -1.0, 12.4, NAN))
    after, estimate = JOINT.step(state, SocSample(1.0, -1.0, NAN, NAN))
    assert after.noise == state.noise
    assert (after.gain == 0).all()
    assert math.isnan(estimate.innovation_V)


def test_parameters_stay_positive():
    samples, _ = simulated(300)
    bad = samples._replace(voltage_V=samples.voltage_V + np.where(np.arange(300) % 2, 3.0, -3.0))
    after, found = run(TextbookJoint(TRUE, start_std=3.0), bad)
    assert (after.belief.mean[:4] >= LEAST).all()
    assert (found.r_terminal_ohm >= 0.99 * LEAST * TRUE.r_terminal_ohm).all()


def test_machine_code_gives_the_same():
    pytest.importorskip("llvmlite")
    samples, _ = simulated(3000)
    (one, found), (other, also) = (run(JOINT, samples, lowering) for lowering in ("python", "machine"))
    np.testing.assert_allclose(one.belief.mean, other.belief.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.innovation_V, also.innovation_V, rtol=0, atol=1e-9)


def test_it_stays_small():
    state = JOINT.init(SocSample(0.0, 0.0, 12.5, NAN))
    assert 900 < len(trace(JOINT.step, state, EXAMPLE).nodes) <= 1120


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"start_std": 0.0}, "start_std"),
        ({"walk": (-1.0,) * 7}, "walk"),
        ({"walk": (1.0,) * 6}, "7 numbers"),
        ({"voltage_std_V": NAN}, "voltage_std_V"),
        ({"window": 0.0}, "window"),
        ({"nominal": Nominal(0.0, 1.0, 1.0, 1.0)}, "nominal.c_bulk_F"),
    ],
)
def test_settings_are_checked(change, named):
    with pytest.raises(InputError, match=named):
        TextbookJoint(**({"nominal": TRUE} | change))


def test_a_start_without_a_voltage_is_refused():
    with pytest.raises(InputError, match="no voltage"):
        JOINT.init(SocSample(0.0, 0.0, NAN, NAN))
