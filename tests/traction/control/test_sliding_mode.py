"""The laws against the equations of the wheel, with a truth that is anywhere within the declared uncertainty."""

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction.control import SlidingMode, Uncertainty
from ohmward_lab.traction.compared_slip_laws import FuzzySlidingMode, SlipRatioSlidingMode
from traction.control.examples import LIMITS, SLIDING, UNSURE, WHEEL, motion

RNG = np.random.default_rng(1)
EXACT = Uncertainty(force_N=0.0, acceleration_m_s2=0.0, inertia_factor=1.0)
#: A layer so thin that nearly everything is outside.
THIN = SlidingMode(UNSURE, time_constant_s=1e-9)


def random_motion(rng, rim, travel):
    return motion(
        rim_m_s=rim,
        travel_m_s=travel,
        acceleration_m_s2=rng.uniform(-3, 3),
        force_N=rng.uniform(-90, 90),
        slip_target=rng.uniform(-0.5, 0.5),
        target_rate_per_s=rng.uniform(-5, 5),
        dt_s=1e-12,
    )


def random_truth(rng, m, unsure=UNSURE):
    """Force, acceleration and inertia at the edges of what is declared, where it is hardest."""
    force = m.force_N + rng.choice([-1, 1]) * unsure.force_N
    acceleration = m.acceleration_m_s2 + rng.choice([-1, 1]) * unsure.acceleration_m_s2
    return force, acceleration, WHEEL.inertia_kg_m2 * unsure.inertia_factor ** rng.choice([-1, 1])


def sigma_rate(m, torque, force, acceleration, inertia):
    here = SLIDING.surface(m)
    wheel = WHEEL.radius_m * (torque - WHEEL.radius_m * force) / inertia
    return here.gain * wheel - here.drift * acceleration - here.reference_speed * m.target_rate_per_s


@pytest.mark.parametrize("law", [THIN, FuzzySlidingMode(THIN)], ids=["sliding", "fuzzy"])
def test_outside_the_layer_sigma_comes_down_whatever_the_truth(law):
    plain = law.sliding if isinstance(law, FuzzySlidingMode) else law
    worst = -np.inf
    for _ in range(2000):
        m = random_motion(RNG, *RNG.uniform(-3, 3, 2))
        torque = law.torque_Nm(law.init(0.0), m, WHEEL)
        sigma = plain.surface(m).sigma
        rate = sigma_rate(m, torque, *random_truth(RNG, m))
        worst = max(worst, np.sign(sigma) * rate + plain.reaching_m_s2)
    assert worst <= 1e-9


def rate_at_the_edge_of_the_layer(force_share):
    """The worst of sign(sigma) dsigma/dt + eta where |sigma| is just the layer, of a law that takes dF for so much."""
    unsure = Uncertainty(force_share * UNSURE.force_N, UNSURE.acceleration_m_s2, UNSURE.inertia_factor)
    law, worst = SlidingMode(unsure), -np.inf
    for _ in range(500):
        m = random_motion(RNG, *RNG.uniform(-3, 3, 2))
        here = law.surface(m)
        torque = law.torque_with(law.gain_m_s2(here, m, WHEEL), abs(here.sigma), law.init(0.0), m, WHEEL)
        rate = sigma_rate(m, torque, *random_truth(RNG, m))
        worst = max(worst, np.sign(here.sigma) * rate + law.reaching_m_s2)
    return worst


def test_the_gain_is_the_least_that_does_it():
    assert rate_at_the_edge_of_the_layer(1.0) <= 1e-9
    assert rate_at_the_edge_of_the_layer(0.9) > 1.0


def test_far_outside_the_layer_all_the_torque_there_is_ends_a_spin():
    spinning = motion(rim_m_s=10.0, travel_m_s=0.3)
    assert SLIDING.torque_Nm(SLIDING.init(0.0), spinning, WHEEL) < -3 * LIMITS.torque_Nm


def test_the_rate_at_which_a_slip_is_reached_has_no_step_at_the_edge_of_the_layer():
    rims = 1.0 / 0.88 + np.linspace(0.0, 0.5, 2001)
    torque = np.array([SLIDING.torque_Nm(SLIDING.init(0.0), motion(rim_m_s=rim), WHEEL) for rim in rims])
    change = np.diff(torque)
    assert (change < 0).all() and np.abs(np.diff(change)).max() < 0.03 * np.abs(change).max()


def test_a_wheel_without_ground_comes_down_from_a_spin_with_a_torque_that_changes_evenly():
    """dF = 0 and F = 0: tau = -J k sqrt(2 s / Phi - 1) / (gain r), and s'' = k^2 / Phi wherever s > Phi."""
    unsure = Uncertainty(force_N=50.0, acceleration_m_s2=0.0, inertia_factor=1.0)
    law, dt_s, rim, torques = SlidingMode(unsure, time_constant_s=0.01), 1e-4, 20.0, []
    for _ in range(3000):
        m = motion(rim_m_s=rim, travel_m_s=0.0, slip_target=0.0, force_N=0.0, acceleration_m_s2=0.0, dt_s=dt_s)
        torques.append(law.torque_Nm(law.init(0.0), m, WHEEL))
        rim += dt_s * WHEEL.radius_m * torques[-1] / WHEEL.inertia_kg_m2
    k = law.gain_m_s2(law.surface(m), m, WHEEL)
    change = np.diff(torques)[: int(0.8 * np.argmax(np.array(torques) > -k * WHEEL.inertia_kg_m2 / WHEEL.radius_m))]
    expected = k * WHEEL.inertia_kg_m2 / WHEEL.radius_m / law.time_constant_s * dt_s
    assert change == pytest.approx(np.full(len(change), expected), rel=0.02)
    assert abs(rim) < 1e-3


@pytest.mark.parametrize("before_Nm", [-3.0, 0.0, 3.0])
def test_torque_grows_gradually_and_goes_to_zero_at_once(before_Nm):
    m = motion(rim_m_s=10.0, travel_m_s=0.3)
    k = SLIDING.gain_m_s2(SLIDING.surface(m), m, WHEEL)
    growth = k * WHEEL.inertia_kg_m2 / WHEEL.radius_m / SLIDING.surface(m).gain / SLIDING.time_constant_s * m.dt_s / 2
    torque = SLIDING.torque_Nm(SLIDING.init(0.0), m._replace(torque_before_Nm=before_Nm), WHEEL)
    assert torque == pytest.approx(min(before_Nm, 0.0) - growth)
    assert SLIDING.torque_Nm(SLIDING.init(0.0), m._replace(torque_before_Nm=-60.0), WHEEL) > -60.0


def test_the_law_of_the_slip_ratio_keeps_its_condition():
    law = SlipRatioSlidingMode(UNSURE, layer=1e-12, time_constant_s=0.0)
    worst = -np.inf
    for _ in range(2000):
        rim, travel = RNG.uniform(0.1, 3, 2)
        if rim > 15 * travel:
            continue
        m = random_motion(RNG, rim, travel)
        force, acceleration, inertia = random_truth(RNG, m)
        torque = law.torque_Nm(law.init(0.0), m, WHEEL)
        V, slip = max(rim, travel), (rim - travel) / max(rim, travel)
        rim_rate = WHEEL.radius_m * (torque - WHEEL.radius_m * force) / inertia
        rate = (travel * rim_rate / V - acceleration) / V if rim > travel else (rim_rate - rim * acceleration / V) / V
        sign = np.sign(slip - m.slip_target)
        worst = max(worst, sign * (rate - m.target_rate_per_s) + law.reaching_per_s)
    assert worst <= 1e-8


def test_knowing_everything_the_torque_is_what_the_surface_needs():
    law = SlidingMode(EXACT)
    m = motion(rim_m_s=1.0 / 0.88, slip_target=0.12)
    assert law.surface(m).sigma == pytest.approx(0.0, abs=1e-12)
    torque = law.torque_Nm(law.init(0.0), m, WHEEL)
    assert sigma_rate(m, torque, m.force_N, m.acceleration_m_s2, WHEEL.inertia_kg_m2) == pytest.approx(0.0, abs=1e-9)
    rim_rate = m.acceleration_m_s2 / 0.88
    assert torque == pytest.approx(WHEEL.radius_m * m.force_N + WHEEL.inertia_kg_m2 * rim_rate / WHEEL.radius_m)


def test_knowing_everything_both_laws_are_one_on_the_surface():
    m = motion(rim_m_s=1.0 / 0.88, slip_target=0.12, target_rate_per_s=2.0)
    of_ratio, of_speed = SlipRatioSlidingMode(EXACT), SlidingMode(EXACT)
    torque = of_speed.torque_Nm(of_speed.init(0.0), m, WHEEL)
    assert of_ratio.torque_Nm(of_ratio.init(0.0), m, WHEEL) == pytest.approx(torque)


def test_inside_the_layer_sigma_decays_with_the_time_constant():
    law = SlidingMode(EXACT, time_constant_s=0.02)
    m = motion(rim_m_s=1.1363)
    rate = sigma_rate(m, law.torque_Nm(law.init(0.0), m, WHEEL), m.force_N, m.acceleration_m_s2, WHEEL.inertia_kg_m2)
    assert rate == pytest.approx(-law.surface(m).sigma / 0.02)


def test_a_slow_controller_gets_a_wider_layer():
    assert SLIDING.layer_m_s(10.0, 0.01) == pytest.approx(10.0 * 0.05)
    assert SLIDING.layer_m_s(10.0, 1e-4) == pytest.approx(10.0 * SLIDING.time_constant_s)


def test_spinning_at_standstill_and_rest_are_states_like_any_other():
    for rim in (0.0, 0.01, 2.0):
        assert np.isfinite(SLIDING.torque_Nm(SLIDING.init(0.0), motion(rim_m_s=rim, travel_m_s=0.0), WHEEL))


def test_the_integral_stops_only_where_it_would_push_a_limited_torque():
    memory, above = SLIDING.init(0.0), motion(rim_m_s=1.2)
    assert SLIDING.remember(memory, above, -20.0, -20.0).integral_m > 0
    assert SLIDING.remember(memory, above, -20.0, -12.0).integral_m == 0
    assert SLIDING.remember(memory, above, 20.0, 12.0).integral_m > 0


@pytest.mark.parametrize("rim_m_s", [0.5, 2.0, 60.0])
def test_the_integral_rests_while_the_slip_is_on_its_way(rim_m_s):
    assert SLIDING.remember(SLIDING.init(0.3), motion(rim_m_s=rim_m_s), 0.0, 0.0).integral_m == 0.3


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Uncertainty(-1.0), "uncertainty.force_N must be >= 0"),
        (lambda: Uncertainty(1.0, inertia_factor=0.9), "uncertainty.inertia_factor must be >= 1"),
        (lambda: SlidingMode(UNSURE, time_constant_s=0.0), "sliding_mode.time_constant_s must be > 0"),
        (lambda: SlipRatioSlidingMode(UNSURE, layer=-0.1), "slip_ratio_sliding_mode.layer must be > 0"),
    ],
)
def test_bad_settings_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
