"""The joint filter as published: its step is [T]'s, it is the generic adaptive filter, and no sample stops it."""

import math
from functools import partial

import numpy as np
import pytest

from battery.rc_examples import EVEN, drive, rates_with_voltage
from kernels import kernel_of
from ohmward.battery.models import rc
from ohmward.battery.soc.sample import SocSample
from ohmward.errors import InputError
from ohmward.filters import adaptive
from ohmward.filters.belief import unpack
from ohmward.published.rc_joint import Nominal
from ohmward.published.textbook_joint import LEAST, TextbookJoint
from ohmward.trace import trace

TRUE = Nominal(EVEN.c_bulk_F, EVEN.c_surface_F, EVEN.r_bulk_ohm, EVEN.r_terminal_ohm)
JOINT = TextbookJoint(Nominal(1.3 * TRUE.c_bulk_F, 0.8 * TRUE.c_surface_F, 1.2 * TRUE.r_ohm, 0.8 * TRUE.r_terminal_ohm))
NAN = math.nan
EXAMPLE = SocSample(0.0, 0.0, 0.0, 0.0)


def circuit_of(nominal, z):
    """The elements that the first four states say."""
    r = nominal.r_ohm / z[2]
    return rc.Circuit(nominal.c_bulk_F / z[0], nominal.c_surface_F / z[1], r, r, nominal.r_terminal_ohm * z[3])


def simulated(count=3000, voltage_std_V=0.002, seed=0):
    """A log of a battery that is what the filter thinks: Euler steps, di/dt = 0."""
    rng = np.random.default_rng(seed)
    current_A = drive(rng, count, hold=40)
    mean_A = 0.5 * (current_A + np.concatenate([current_A[:1], current_A[:-1]]))
    A, B = rates_with_voltage(EVEN)
    states = np.full((count, 3), 12.5)
    for k, i in enumerate(mean_A[1:]):
        states[k + 1] = states[k] + A @ states[k] + B * i
    voltage_V = states[:, 2] + voltage_std_V * rng.standard_normal(count)
    return SocSample(np.ones(count), current_A, voltage_V, np.full(count, NAN)), states


def rows(samples):
    return [SocSample(*map(float, row)) for row in zip(*samples, strict=True)]


def run(joint, samples, lowering="python"):
    first = SocSample(*(float(column[0]) for column in samples))
    state = joint.init(first)
    return kernel_of(joint, state, EXAMPLE, lowering=lowering).scan(state, samples)


def test_the_model_is_an_euler_step_of_the_circuit():
    z, voltages = np.array([1.1, 0.7, 1.3, 0.9]), np.array([12.1, 12.0, 11.7])
    A, B = rates_with_voltage(circuit_of(JOINT.nominal, z))
    after = JOINT.next_state(np.array([*z, *voltages]), -3.0, 0.5)
    np.testing.assert_allclose(after, [*z, *(voltages + 0.5 * (A @ voltages + B * -3.0))], rtol=0, atol=1e-13)


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
            partial(JOINT.next_state, current_A=mean_A, dt_s=1.0),
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
    after, _ = run(TextbookJoint(TRUE, start_std=3.0), bad)
    assert (after.belief.mean[:4] >= LEAST).all()


def test_machine_code_gives_the_same():
    pytest.importorskip("llvmlite")
    samples, _ = simulated(3000)
    (one, found), (other, also) = (run(JOINT, samples, lowering) for lowering in ("python", "machine"))
    np.testing.assert_allclose(one.belief.mean, other.belief.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.innovation_V, also.innovation_V, rtol=0, atol=1e-9)


def test_it_stays_small():
    state = JOINT.init(SocSample(0.0, 0.0, 12.5, NAN))
    assert 900 < len(trace(JOINT.step, state, EXAMPLE).nodes) <= 1100


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
