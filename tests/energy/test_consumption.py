from dataclasses import replace

import numpy as np
import pytest

from energy.examples import PRIOR, certain, learned
from ohmward.energy.consumption import (
    CLIMB,
    HEAT,
    Consumption,
    Variance,
    begin_drive,
    design_row,
    energy_demand,
    jacobian,
    learn,
    scatter_J2,
    standing_work_J,
    start,
    with_terrain,
)
from ohmward.energy.consumption_prior import ConsumptionPrior, prior_from_mass
from ohmward.energy.leg import Leg, Stretch, part_of, stretch_of, way_back
from ohmward.errors import InputError

SURE = 1e15
ICE = stretch_of(Leg(1.0, "ice", 1.0))


def known_variances(c: Consumption, scatter_m: float, day_std: float) -> Consumption:
    scatter, day, idle_noise = (Variance(SURE, SURE * v) for v in (scatter_m, day_std**2, c.idle_noise.value))
    return begin_drive(replace(c, scatter=scatter, day=day, idle_noise=idle_noise))


def some_stretches(seed, count):
    rng = np.random.default_rng(seed)
    names = rng.choice(["grass", "gravel"], count)
    return [
        stretch_of(Leg(rng.uniform(5, 80), name, rng.uniform(0.2, 1.0), rng.normal(0, 0.03), rng.uniform(0, 30), 5.0))
        for name in names
    ]


def test_one_drive_against_the_joint_gaussian():
    c = known_variances(with_terrain(with_terrain(start(PRIOR), "grass"), "gravel"), 0.5, 0.15)
    stretches = some_stretches(1, 9)
    errors_J = np.random.default_rng(2).normal(0.0, 300.0, 9)
    first, rows, noise, y = c, [], [], []
    for s, error_J in zip(stretches, errors_J, strict=True):
        rows.append(design_row(c, s))
        noise.append(sum(scatter_J2(c, s)))
        y.append(rows[-1] @ first.mean + error_J)
        c = learn(c, s, y[-1])
    X, R, found, c = np.array(rows), np.diag(noise), c, first
    gain = c.cov @ X.T @ np.linalg.inv(X @ c.cov @ X.T + R)
    mean, cov = c.mean + gain @ (np.array(y) - X @ c.mean), c.cov - gain @ X @ c.cov
    assert found.mean == pytest.approx(mean, rel=1e-9)
    assert found.cov == pytest.approx(cov, rel=1e-7, abs=1e-10)


def test_several_drives_against_regression_with_an_effect_of_each_drive():
    # forces of the prior are those of each drive, so the effects of the drives are linear with known sizes
    scatter_m, day_std = 0.7, 0.2
    c = known_variances(with_terrain(start(PRIOR), "grass"), scatter_m, day_std)
    shared = [0, 1, 2, 3, 6]
    rows, effects, noise, y = [], [], [], []
    rng = np.random.default_rng(3)
    for drive in range(4):
        c = begin_drive(c)
        c = replace(c, reference_N=(20.0,))
        for s in some_stretches(drive, 4):
            s = s._replace(terrain="grass", descent_m=0.0)  # wheels that never brake: all is linear
            x = design_row(c, s)
            energy_J = x @ with_terrain(start(PRIOR), "grass").mean + rng.normal(0.0, 200.0)
            rows.append(x[shared])
            effects.append(x[7] * np.eye(4)[drive])
            noise.append(sum(scatter_J2(c, s)))
            y.append(energy_J)
            c = learn(c, s, energy_J)
    X, Z, first = np.array(rows), np.array(effects), with_terrain(start(PRIOR), "grass")
    # both day effects: together tau^2, new in each drive
    V = np.diag(noise) + day_std**2 * Z @ Z.T
    P0 = first.cov[np.ix_(shared, shared)]
    P = np.linalg.inv(np.linalg.inv(P0) + X.T @ np.linalg.inv(V) @ X)
    mean = P @ (np.linalg.inv(P0) @ first.mean[shared] + X.T @ np.linalg.inv(V) @ np.array(y))
    assert c.mean[shared] == pytest.approx(mean, rel=1e-6)
    assert c.cov[np.ix_(shared, shared)] == pytest.approx(P, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("grade_rad", [-0.2, -0.05, 0.0, 0.12])
def test_the_jacobian_against_differences(grade_rad):
    c = with_terrain(start(PRIOR), "grass")
    mean = c.mean.copy()
    mean[HEAT] = 0.01
    c = replace(c, mean=mean)
    s = stretch_of(Leg(40.0, "grass", 0.7, grade_rad, payload_kg=3.0))

    def energy_J(moved):
        k = replace(c, mean=moved)
        return design_row(k, s) @ moved

    found = jacobian(c, s, design_row(c, s))
    for i, x in enumerate(c.mean):
        if i in c.day_effects:
            continue  # counted at the battery
        h = 1e-6 * max(abs(x), 1.0)
        step = h * np.eye(len(c.mean))[i]
        assert found[i] == pytest.approx((energy_J(c.mean + step) - energy_J(c.mean - step)) / (2 * h), rel=1e-5), i


def test_a_ground_ten_times_as_heavy_as_believed_is_found_from_few_stretches():
    c = with_terrain(start(prior_from_mass(42.0, 12.0)), "grass")
    mean = c.mean.copy()
    mean[c.force_index("grass")] *= 10.0
    truth = replace(c, mean=mean)
    for s in some_stretches(1, 12):
        s = s._replace(terrain="grass")
        c = learn(c, s, float(design_row(truth, s) @ mean))
    assert c.mean[CLIMB] > 0.5 and c.mean[HEAT] > 0.0
    level = stretch_of(Leg(50.0, "grass", 0.5))
    assert energy_demand(c, [level]).mean_J == pytest.approx(float(design_row(truth, level) @ mean), rel=0.05)


def test_a_terrain_may_be_added_at_any_time():
    early = with_terrain(with_terrain(start(PRIOR), "grass"), "gravel")
    late = with_terrain(start(PRIOR), "grass")
    for s in some_stretches(5, 6):
        s = s._replace(terrain="grass")
        early, late = learn(early, s, 2000.0), learn(late, s, 2000.0)
    late = with_terrain(late, "gravel")
    assert late.mean == pytest.approx(early.mean)
    assert late.cov == pytest.approx(early.cov)


def test_with_known_coefficients_the_scatter_is_learned_by_the_conjugate_rule():
    c = replace(certain(idle_W=10.0, force_N=20.0), scatter=Variance(4.0, 4.0))
    s = stretch_of(Leg(50.0, "grass", 0.5))  # 2000 J; sigma^2 counts 20^2 * 50 = 20000 times
    for error_J in (50.0, -30.0, 80.0):
        c = learn(c, s, 2000.0 + error_J)
    assert c.scatter == pytest.approx((7.0, 4.0 + (2500.0 + 900.0 + 6400.0) / 20000.0))


def test_standing_teaches_the_idle_power_only():
    before, standing = start(PRIOR), Stretch("", 600.0)
    c = learn(before, standing, 600.0 * 14.0)
    assert c.mean[0] == pytest.approx(14.0, abs=0.1)
    assert c.mean[1:] == pytest.approx(before.mean[1:])
    assert c.scatter == before.scatter


def test_with_a_known_idle_power_its_noise_is_learned_by_the_conjugate_rule():
    c = replace(certain(idle_W=10.0), idle_noise=Variance(4.0, 400.0))
    for error_W in (2.0, -1.0):
        c = learn(c, Stretch("", 60.0), 60.0 * (10.0 + error_W))
    assert c.idle_noise == pytest.approx((6.0, 400.0 + 60.0 * (4.0 + 1.0)))


def test_a_varying_idle_power_is_as_uncertain_as_its_standing_shows():
    errors, rng = [], np.random.default_rng(1)
    for _ in range(40):
        c = start(PRIOR)
        for _ in range(25):
            c = learn(c, Stretch("", 60.0), 60.0 * (14.0 + rng.normal(0.0, 4.0)))
        errors.append((c.mean[0] - 14.0) / np.sqrt(c.cov[0, 0]))
    assert 0.7 < np.std(errors) < 1.3


def test_starts_and_stops_are_counted_and_teach_nothing():
    before = with_terrain(start(PRIOR), "grass")
    c = learn(before, Stretch("grass", 1.0, 0.1, 0.02), 90.0)
    assert c.visits[0] == (1, 0.1, 1.0, 90.0)
    assert np.array_equal(c.mean, before.mean) and c.scatter == before.scatter


def test_gaining_speed_is_work_like_gaining_height():
    c = certain(idle_W=0.0, force_N=20.0, climb=1.5)
    s = stretch_of(Leg(100.0, "grass", 0.5))
    faster = s._replace(kinetic_m2_s2=0.5 * (0.8**2 - 0.2**2))
    higher = s._replace(climb_m=0.5 * (0.8**2 - 0.2**2) / 9.80665)
    assert energy_demand(c, [faster]).mean_J == pytest.approx(energy_demand(c, [higher]).mean_J)
    assert energy_demand(c, [faster]).mean_J == pytest.approx(2000.0 + 1.5 * 40.0 * 0.3)


def test_windings_heat_with_the_square_of_the_pull():
    c = certain(idle_W=0.0, force_N=20.0, climb=1.0)
    mean = c.mean.copy()
    mean[HEAT] = 0.01
    c = replace(c, mean=mean)
    s = stretch_of(Leg(100.0, "grass", 0.5, 0.05, stop_s=500.0))
    pull_N = 20.0 + 40.0 * 9.80665 * np.sin(0.05)
    assert energy_demand(c, [s]).mean_J == pytest.approx(pull_N * 100.0 + 0.01 * pull_N**2 * 200.0)


def test_windings_heat_while_the_robot_is_under_way_and_not_in_short_stops():
    c = certain(idle_W=0.0, force_N=20.0, climb=1.0)
    mean = c.mean.copy()
    mean[HEAT] = 0.01
    c = replace(c, mean=mean)
    two_speeds = Stretch("grass", 320.0, 100.0, 50.0 * 0.25 + 50.0 * 1.0, standing_s=70.0)
    assert energy_demand(c, [two_speeds]).mean_J == pytest.approx(2000.0 + 0.01 * 400.0 * 250.0)
    assert part_of(two_speeds, 0.5).standing_s == 35.0


def test_the_variances_are_found():
    rng, c = np.random.default_rng(6), start(replace(PRIOR, scatter_m=1.0))
    for _ in range(150):
        c = begin_drive(c)
        common = rng.normal(0.0, 0.2 / np.sqrt(2))
        single = {name: rng.normal(0.0, 0.2 / np.sqrt(2)) for name in ("grass", "gravel")}
        for s in some_stretches(rng.integers(1 << 30), 8):
            force_N = {"grass": 30.0, "gravel": 15.0}[s.terrain] * (1 + common + single[s.terrain])
            x = design_row(with_terrain(c, s.terrain), s)
            expected = 12.0 * x[0] + 4.0 * x[1] + 1.4 * x[2] + 0.5 * x[3] + force_N * s.distance_m * 45.0 / 40.0
            c = learn(c, s, expected + rng.normal(0.0, np.sqrt(2.0) * force_N * np.sqrt(s.distance_m)))
    assert c.scatter.value == pytest.approx(2.0 * (45.0 / 40.0) ** -2, rel=0.12)
    assert np.sqrt(c.day.value) == pytest.approx(0.2, rel=0.2)
    assert c.mean[[0, 2]] == pytest.approx([12.0, 1.4], abs=0.4)
    assert c.mean[c.force_index("grass")] == pytest.approx(30.0, rel=0.05)


def test_what_is_predicted_of_a_day():
    c = certain(idle_W=10.0, force_N=20.0, speed_N_s_per_m=4.0, climb=1.5, regeneration=0.5)
    level_J = 10.0 * 220.0 + 1.1 * (20.0 * 100.0 + 4.0 * 0.5 * 100.0)
    lift_J = 44.0 * 9.80665 * 100.0 * np.sin(0.02)
    for sign in (1.0, -1.0):
        found = energy_demand(c, [stretch_of(Leg(100.0, "grass", 0.5, sign * 0.02, stop_s=20.0, payload_kg=4.0))])
        assert found.mean_J == pytest.approx(level_J + sign * 1.5 * lift_J)


def test_a_steep_slope_gives_back_only_a_share_of_the_braking():
    # down 0.2: the drive does nothing, resistance of 20 N at the battery is 10 N at the wheels
    c = certain(idle_W=10.0, force_N=20.0, climb=2.0, regeneration=0.3)
    found = energy_demand(c, [stretch_of(Leg(100.0, "grass", 0.5, -0.2))])
    braking_J = (40.0 * 9.80665 * np.sin(0.2) - 10.0) * 100.0
    assert found.mean_J == pytest.approx(10.0 * 200.0 - 0.3 * braking_J)


def test_what_gentle_slopes_do_not_teach_of_steep_ones():
    c = certain(regeneration=0.5)
    doubtful = replace(c, prior=replace(c.prior, slope_std=0.15))
    level, up = stretch_of(Leg(100.0, "grass", 0.5)), stretch_of(Leg(100.0, "grass", 0.5, 0.12))
    down = way_back(up)
    climb_J = 40.0 * 9.80665 * 100.0 * np.sin(0.12)
    assert energy_demand(doubtful, [level]).std_J == energy_demand(c, [level]).std_J
    assert energy_demand(doubtful, [up]).std_J == pytest.approx(0.15 * climb_J, rel=1e-5)
    spared_J = 2000.0 + 0.5 * (climb_J - 2000.0)  # the resistance, and half of the braking
    assert energy_demand(doubtful, [up, down]).std_J == pytest.approx(0.15 * (climb_J - spared_J), rel=1e-5)
    assert energy_demand(doubtful, [Stretch("", 10.0)]).std_J == energy_demand(c, [Stretch("", 10.0)]).std_J


def test_this_drive_is_known_better_than_the_next():
    c = learned()
    leg = [stretch_of(Leg(1000.0, "grass", 0.5))]
    before = energy_demand(c, leg)
    for _ in range(10):
        c = learn(c, stretch_of(Leg(40.0, "grass", 0.5)), 40.0 * 60.0)
    now, tomorrow = energy_demand(c, leg), energy_demand(begin_drive(c), leg)
    assert now.std_J < 0.6 * before.std_J
    assert tomorrow.std_J > 1.5 * now.std_J


def test_a_heavy_day_shows_on_the_other_terrain_too():
    c = learned(8)
    gravel = [stretch_of(Leg(1000.0, "gravel", 0.5))]
    light = energy_demand(c, gravel).mean_J
    for _ in range(10):
        s = stretch_of(Leg(40.0, "grass", 0.5))
        c = learn(c, s, 1.4 * energy_demand(c, [s]).mean_J)
    assert energy_demand(c, gravel).mean_J > 1.02 * light


@pytest.mark.parametrize(
    ("before_s", "now_s", "days"),
    [(1.8e9, 1.8e9 + 86400.0, 1.0), (1.8e9, 1.7e9, 0.0), (None, 1.8e9, None), (60.0, 1.8e9, None), (1.8e9, 60.0, None)],
    ids=["a day", "set back", "no date", "learnt in 1970", "now in 1970"],
)
def test_days_pass_between_dates_of_clocks_that_somebody_has_set(before_s, now_s, days):
    assert replace(learned(), last_drive_unix_s=before_s).days_until(now_s) == days


def test_months_make_unsure():
    c = learned()
    k = c.force_index("grass")
    later = begin_drive(c, days=300.0)
    assert later.cov[k, k] - c.cov[k, k] == pytest.approx(10 * (0.05 * 20.0) ** 2)
    assert later.mean[k] == c.mean[k]


def test_a_smooth_floor_teaches_nothing_of_other_terrains():
    c = start(PRIOR)
    for _ in range(50):
        s = stretch_of(Leg(40.0, "floor", 0.5))
        c = learn(c, s, energy_demand(with_terrain(c, "floor"), [s]).mean_J)
    new = with_terrain(c, "mud")
    k = new.force_index("mud")
    assert new.cov[k, k] == PRIOR.force_std_N**2


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: energy_demand(learned(), [stretch_of(Leg(1.0, "ice", 1.0))]),
            "terrain 'ice' is not .* knows: grass, gravel",
        ),
        (lambda: learn(learned(), Stretch("grass", 1.0, -2.0), 1.0), "stretch.distance_m must be >= 0, got -2"),
        (lambda: learn(learned(), Stretch("sand", 1.0, standing_s=3.0), 1.0), "standing_s must be between 0 and 1"),
        (lambda: learn(learned(), Stretch("grass", 1.0, 2.0), np.nan), "energy_J must be finite"),
        (lambda: ConsumptionPrior(0.0, 1.0, 1.0, 1.0, 1.0), "prior.mass_kg must be > 0"),
        (lambda: begin_drive(learned(), -1.0), "days must be >= 0"),
        (lambda: Leg(-5.0, "grass", 0.5), "leg.distance_m must be >= 0, got -5"),
        (lambda: Leg(5.0, "grass", 0.0), "leg.speed_m_s must be > 0"),
        (lambda: Leg(5.0, "", 0.5), "leg.terrain must be a name"),
        (lambda: Leg(5.0, "grass", 0.5, 10.0), "leg.grade_rad must be between"),
    ],
)
def test_what_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_a_jump_of_the_speed_between_two_samples_is_no_force():
    c = with_terrain(start(PRIOR), "grass")
    jump = Stretch("grass", 1e-6, 5e-7, 2.5e-7, kinetic_m2_s2=0.1)  # from 0.4 to 0.6 m/s in a microsecond
    assert design_row(c, jump)[HEAT] < 1.0
    tiny = jump._replace(distance_m=1e-200)
    assert np.isfinite(jacobian(c, tiny, design_row(c, tiny))).all()


@pytest.mark.parametrize("works_first", [True, False])
def test_a_tool_at_standstill_is_no_idle_power(works_first):
    """200 W for an hour, beside drives that take 50 W: 10 W of electronics, and 80 N at 0.5 m/s."""
    work, way = (Stretch("", 180.0), 36_000.0), (stretch_of(Leg(90.0, "grass", 0.5)), 9000.0)
    c = start(PRIOR)
    for part in (work, way) if works_first else (way, work):
        for _ in range(20):
            c = learn(c, *part)
    assert c.mean[0] < 25.0 and standing_work_J(c, *work) == pytest.approx(36_000.0 - 180.0 * c.mean[0])
    assert energy_demand(c, [way[0]]).mean_J == pytest.approx(9000.0, rel=0.02)
