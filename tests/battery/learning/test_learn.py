"""Learning against independent solutions: a Kalman filter, finite differences, and the same logs in other orders."""

import sys
from dataclasses import replace

import numpy as np
import pytest
import threadpoolctl

from battery.learning.test_another_battery import day, taught_by
from cli.examples import MODEL
from ohmward.battery.battery import Battery, Knowledge
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import load_battery, save_battery
from ohmward.battery.learning import learn
from ohmward.battery.learning.fold import fold
from ohmward.battery.learning.parameters import parameters_of, prior_covariance
from ohmward.battery.learning.samples import samples_of
from ohmward.battery.learning.solve import PartProblem, moments, solve
from ohmward.battery.learning.voltage_model import CurvePlace, VoltageModel, file_charge, prior_of, true_soc
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.soc.anchor_rule import SocAnchor
from ohmward.errors import InputError
from ohmward.filters.belief import Belief
from ohmward.logs import Log

TESTED = Battery("tested", 12.0, "nmc", 3, 5.0, 14.0, thevenin=MODEL, noise=BatteryNoise(capacity_std=0.1))


def problem(battery: Battery, log: Log) -> tuple[VoltageModel, Belief]:
    (samples,) = samples_of(log, battery)
    model = VoltageModel(battery, samples, samples.rows)
    prior = prior_of(model, 0.005)
    prior.mean[model.unknowns.group("start soc")] = 1.0
    return model, prior


def test_a_search_that_begins_where_another_ended_does_not_run_the_circuit_again(monkeypatch):
    model, prior = problem(TESTED, day(MODEL, 1))
    found, runs = model.predict(prior.mean), []
    monkeypatch.setattr(VoltageModel, "circuit", lambda self, x: runs.append(x))
    assert model.predict(prior.mean.copy()) is found
    assert not runs


def test_learning_keeps_blas_on_one_thread(monkeypatch):
    pools: list[int] = []

    def record(*_):
        pools.extend(pool["num_threads"] for pool in threadpoolctl.threadpool_info())
        raise InputError("seen enough")

    monkeypatch.setattr(sys.modules[learn.__module__], "new_parts", record)
    learn(TESTED, [day(MODEL, 1)])
    assert set(pools) == {1}


def test_the_covariance_of_a_file_is_made_positive_definite_once():
    learnt = taught_by(1).knowledge
    assert learnt is not None
    assert learnt.matrix is learnt.matrix
    with pytest.raises(ValueError, match="read-only"):
        learnt.matrix[0, 0] = 1.0


def test_the_solution_is_that_of_a_kalman_filter_that_considers_the_places_of_empty_and_full():
    model, prior = problem(TESTED, day(MODEL, 1))
    anchors = [SocAnchor(0, 1.0, 0.01)]
    found = solve(PartProblem(model, prior, anchors), prior.mean, most_steps=40)
    p = model.predict(found.x)
    # linear about the solution, the robust factor of each row as the solution has it
    robust = np.sqrt(1.0 + found.residual_V**2 / (found.variance_V2 * found.misfit) / 2.5**2)
    slope_V = p.voltage_columns[:, model.unknowns.group("start soc")]
    of_places = slope_V * np.column_stack([1.0 - p.soc.clip(0.0, 1.0), p.soc.clip(0.0, 1.0)])
    rows = [*zip(p.voltage_columns, found.residual_V, found.variance_V2 / found.weight * robust, strict=True)]
    rows.append((p.charge.soc_columns(np.array([0]))[0], 1.0 - p.charge.soc[0], 0.01**2))
    highest = int(np.argmax(p.charge.soc))
    if p.charge.soc[highest] > 1.0:
        of_highest = p.charge.soc_columns(np.array([highest]))[0]
        rows.append((of_highest, 1.0 - p.charge.soc[highest], 0.01**2))
    mean, P, moved = prior.mean.copy(), prior.cov.copy(), np.zeros((prior.mean.size, 2))
    for k, (column, residual, variance) in enumerate(rows):
        gain = P @ column / (column @ P @ column + variance)
        mean += gain * (residual + column @ (found.x - mean))
        moved += np.outer(gain, (of_places[k] if k < len(of_places) else 0.0) - column @ moved)
        P -= np.outer(gain, column @ P)
    std = np.sqrt(np.diag(P))
    assert np.sqrt(np.diag(found.within)) == pytest.approx(std, rel=1e-3)
    assert np.max(np.abs(mean - found.x) / std) < 0.1
    with_places = np.sqrt(np.diag(P + TESTED.noise.soc_axis_std**2 * moved @ moved.T))
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(with_places, rel=1e-3)


def test_the_columns_are_the_derivatives_of_the_voltage():
    model, prior = problem(TESTED, day(MODEL, 1))
    rng = np.random.default_rng(0)
    x = prior.mean + 0.1 * np.sqrt(np.diag(prior.cov)) * rng.standard_normal(prior.mean.size)
    columns = model.predict(x).voltage_columns
    p = model.unknowns
    for k in p.places("ohmic", "pair", "ocv", "misfit"):
        step = np.zeros(x.size)
        step[k] = 1e-4
        difference = (model.predict(x + step).voltage_V - model.predict(x - step).voltage_V) / 2e-4
        assert columns[:, k] == pytest.approx(difference, rel=1e-3, abs=1e-5)
    step = np.zeros(x.size)
    step[p.group("tau").start] = 1e-3
    difference = (model.predict(x + step).voltage_V - model.predict(x - step).voltage_V) / 2e-3
    assert columns[:, p.group("tau").start] == pytest.approx(difference, rel=0.05, abs=2e-4)


def test_an_offset_that_changes_acts_the_same_whether_the_file_doubts_it_or_not():
    sure = replace(TESTED, sensor=replace(TESTED.sensor, offset_std_A=0.0))
    (model, prior), (other, other_prior) = problem(TESTED, day(MODEL, 1)), problem(sure, day(MODEL, 1))
    columns, others = model.predict(prior.mean).voltage_columns, other.predict(other_prior.mean).voltage_columns
    assert model.offset_starts.size == 1
    assert columns[:, model.parameters.size :] == pytest.approx(others[:, other.parameters.size :], abs=1e-12)


def test_a_file_without_corrections_stays_as_it_is():
    p = parameters_of(TESTED)
    folded = fold(TESTED, np.zeros(p.size), prior_covariance(TESTED), 1.0, np.inf)
    soc = np.linspace(0.0, 1.0, 101)
    assert folded.capacity_Ah == TESTED.capacity_Ah
    assert folded.thevenin.ocv.mean_V(soc, 25.0) == pytest.approx(MODEL.ocv.mean_V(soc, 25.0), abs=2e-3)
    assert folded.thevenin.tau_s == MODEL.tau_s
    assert folded.noise.capacity_std <= TESTED.noise.capacity_std


def test_a_learnt_curve_is_the_same_over_the_charge_below_full():
    p = parameters_of(TESTED)
    theta = np.zeros(p.size)
    theta[p.group("capacity")] = np.log(0.9)
    once = fold(TESTED, np.zeros(p.size), prior_covariance(TESTED), 0.0, np.inf)
    smaller = fold(once, theta, prior_covariance(TESTED), 0.0, np.inf)
    charge = np.linspace(0.2, 1.0, 50)
    soc = true_soc(charge, np.log(0.9))
    assert smaller.thevenin.ocv.mean_V(soc, 25.0) == pytest.approx(once.thevenin.ocv.mean_V(charge, 25.0), abs=2e-3)


def test_the_curve_stretches_only_where_no_log_has_been():
    charge = np.linspace(-0.2, 1.0, 25)
    assert CurvePlace(1.0, 0.05).at(charge) == pytest.approx(true_soc(charge, 0.05))
    assert file_charge(true_soc(charge, 0.05), 0.05) == pytest.approx(charge)
    part = CurvePlace(0.4, 0.05)
    assert part.at(charge[charge >= 0.4]) == pytest.approx(charge[charge >= 0.4])
    assert part.at(np.array([part.empty])) == pytest.approx([0.0])
    difference = (CurvePlace(0.4, 0.0501).at(charge) - CurvePlace(0.4, 0.0499).at(charge)) / 2e-4
    assert part.columns(charge)[:, 0] == pytest.approx(difference, abs=1e-3)


def test_moments_of_a_normal_density_are_its_own():
    grid = 0.3 + 0.02 * np.linspace(-5, 5, 41)
    found = moments({float(x): ((x - 0.3) / 0.02) ** 2 for x in grid})
    assert found.mean == pytest.approx(0.3)
    assert found.std == pytest.approx(0.02, rel=0.01)


def test_a_density_is_no_narrower_than_its_points_resolve():
    assert moments({-0.02: 71.0, 0.0: 0.0, 0.02: 41.0}, least_std=0.024).std == 0.024


def test_a_smaller_capacity_is_found_and_covered():
    older = MODEL.worn(0.85, 1.3)
    tested = replace(TESTED, noise=replace(TESTED.noise, resistance_std=0.3, ocv_slip_std=0.0))
    tested = replace(tested, thevenin=replace(MODEL, ocv_slip=0.0))
    learnt = learn(tested, [day(older, 1), day(older, 2)])
    update = learnt.updates[-1]
    assert update.capacity_Ah.mean == pytest.approx(0.85 * 12.0, rel=0.02)
    assert abs(update.capacity_Ah.mean - 0.85 * 12.0) < 2 * update.capacity_Ah.std
    assert update.resistance_ohm.std < 0.1 * update.resistance_ohm.mean


def test_a_log_whose_capacity_has_two_hills_says_nothing_of_it(monkeypatch):
    logs = [day(MODEL.worn(0.85, 1.3), 1)]
    assert learn(TESTED, logs).updates[0].own_capacity_Ah.std < 0.05 * 12.0
    monkeypatch.setattr("ohmward.battery.learning.solve.capacity_marginal", lambda *_: None)
    (update,) = learn(TESTED, logs).updates
    assert update.own_capacity_Ah.std == np.inf
    assert update.capacity_Ah.std > 0.09 * 12.0


def difference_in_sigmas(one: Battery, two: Battery) -> float:
    """Largest difference of capacity, time constants and curve in the standard deviations of their errors."""
    p = parameters_of(one)
    std = np.sqrt(np.diag(prior_covariance(one)))
    log_ratio = np.log(two.capacity_Ah / one.capacity_Ah)
    curves = [np.asarray(b.thevenin.ocv.mean_V(np.linspace(0.3, 1.0, 8), 25.0)) for b in (one, two)]
    model_V = np.interp(np.linspace(0.3, 1.0, 8), np.linspace(0, 1, 21), one.noise.model_std_V)
    slope_V = np.gradient(curves[0], 0.1)
    of_curve = np.abs(curves[0] - curves[1]) / np.hypot(model_V, one.noise.soc_axis_std * slope_V)
    return float(max(abs(log_ratio) / std[p.group("capacity")].sum(), of_curve.max()))


def test_a_circuit_without_rc_pairs_learns_too():
    bare = replace(MODEL, r_ohm=(), tau_s=())
    (update,) = learn(replace(TESTED, thevenin=bare), [day(bare, 1)]).updates
    assert update.verdict == "learnt"
    assert abs(update.capacity_Ah.mean - 12.0) < 2 * update.capacity_Ah.std


def test_what_was_learnt_has_the_date_of_the_last_log_that_has_one():
    label = generic_battery("nmc", 12.0, 3)
    dated, undated = replace(day(MODEL, 1), start_unix_s=1.79e9), day(MODEL, 2)
    learnt = learn(label, [dated]).battery
    once = learnt.noise
    assert once.capacity_known_unix_s == dated.end_unix_s
    assert once.capacity_known_std == once.capacity_std < label.noise.capacity_std
    assert learn(learnt, [undated]).battery.noise.capacity_known_unix_s == dated.end_unix_s
    assert taught_by(1).noise.capacity_known_unix_s == 0.0


@pytest.mark.parametrize(("days", "in_another_order"), [((1, 2), (2, 1)), ((1, 2, 3), (2, 3, 1))])
def test_the_order_of_the_logs_does_not_matter(days, in_another_order):
    assert difference_in_sigmas(taught_by(*days), taught_by(*in_another_order)) < 0.3


def test_logs_with_a_clock_are_taken_in_its_order():
    days = [replace(day(MODEL, seed), start_unix_s=1.79e9 + 1e5 * seed) for seed in (1, 2)]
    updates = learn(generic_battery("nmc", 12.0, 3), days[::-1]).updates
    assert [update.log for update in updates] == ["day 1", "day 2"]


def test_an_older_log_does_not_set_the_date_back():
    label = generic_battery("nmc", 12.0, 3)
    june, january = (replace(day(MODEL, seed), start_unix_s=unix_s) for seed, unix_s in ((1, 1.79e9), (2, 1.77e9)))
    later = learn(learn(label, [june]).battery, [january]).battery
    assert later.noise.capacity_known_unix_s == june.end_unix_s


@pytest.mark.parametrize(
    ("initial_soc", "message"),
    [
        ({"typo": 0.5}, "initial_soc names 'typo', but the logs are "),
        (80, r"must be between 0 and 1 \(0.8 is 80 %\), got 80"),
        ({"day 1": "full"}, "initial_soc of 'day 1' must be a number"),
    ],
)
def test_a_start_that_no_log_can_have_is_refused(initial_soc, message):
    with pytest.raises(InputError, match=message):
        learn(TESTED, [replace(day(MODEL, 1), name="day 1")], initial_soc=initial_soc)


def test_a_parameter_that_became_exact_leaves_the_others_as_they_were_learnt():
    learnt = taught_by(1)
    exact = replace(learnt, noise=replace(learnt.noise, ocv_slip_std=0.0))
    names = parameters_of(exact).names
    assert learnt.knowledge is not None and set(learnt.knowledge.names) - set(names) == {"ocv_slip"}
    still = [learnt.knowledge.names.index(name) for name in names]
    assert prior_covariance(exact) == pytest.approx(learnt.knowledge.matrix[np.ix_(still, still)])


def test_a_log_that_is_cut_in_two_teaches_the_same():
    log = day(MODEL, 1)
    middle_s = float(log.time_s[len(log) // 2])
    parts = [log.between(0.0, middle_s), log.between(middle_s, np.inf)]
    parts = [replace(part, name=f"part {k}") for k, part in enumerate(parts)]
    cut = learn(generic_battery("nmc", 12.0, 3), parts).battery
    assert difference_in_sigmas(taught_by(1), cut) < 0.6


def test_a_log_that_grows_by_a_day_ages_the_battery_by_that_day():
    """A logger that appends to one file; the battery learns from it every night."""
    days = [day(MODEL, seed) for seed in (1, 2, 3)]
    time_s = np.concatenate([log.time_s + 1e5 * k for k, log in enumerate(days)])
    current_A, voltage_V = (np.concatenate([getattr(log, name) for log in days]) for name in ("current_A", "voltage_V"))
    battery = generic_battery("nmc", 12.0, 3)
    for length in np.cumsum([len(log) for log in days]):
        some = slice(length)
        grown = Log("grown", time_s[some], current_A[some], voltage_V[some], np.full(length, 25.0))
        battery = learn(battery, [grown]).battery
    apart, capacity = taught_by(1, 2, 3), parameters_of(battery).group("capacity")
    stds = [np.sqrt(prior_covariance(one)[capacity, capacity].sum()) for one in (battery, apart)]
    assert stds[0] == pytest.approx(stds[1], rel=1e-3)


def test_the_same_log_does_not_count_twice(tmp_path):
    once = taught_by(1)
    save_battery(once, tmp_path / "battery.toml")
    stored = load_battery(tmp_path / "battery.toml")
    twice = learn(stored, [day(MODEL, 1)])
    assert [update.verdict for update in twice.updates] == ["seen"]
    assert twice.battery is stored
    std = np.sqrt(np.diag(prior_covariance(once)))
    scale = np.outer(std, std)
    assert prior_covariance(stored) / scale == pytest.approx(prior_covariance(once) / scale, rel=1e-3, abs=1e-5)


def test_a_knot_that_the_file_did_not_know_follows_its_neighbours():
    """As of a file that learnt when the curve had fewer knots: it goes on learning, and no knot is free."""
    learnt = taught_by(1)
    before, matrix = learnt.knowledge, prior_covariance(learnt)
    assert before is not None
    names = before.names
    known = [k for k, name in enumerate(names) if not name.endswith(("soc 0.96", "soc 0.97", "soc 0.99"))]
    fewer = Knowledge.of(
        tuple(names[k] for k in known),
        matrix[np.ix_(known, known)],
        before.logs,
        before.seen_from_soc,
    )
    older = replace(learnt, knowledge=fewer)
    assert len(known) == len(names) - 3
    std = np.sqrt(np.diag(matrix))
    assert np.sqrt(np.diag(prior_covariance(older)))[known] == pytest.approx(std[known], rel=1e-6)
    new = [k for k in range(len(names)) if k not in known]
    assert np.all(np.sqrt(np.diag(prior_covariance(older)))[new] < 2 * std[new])
    one, two = (learn(battery, [day(MODEL, 2)]).battery for battery in (learnt, older))
    assert difference_in_sigmas(one, two) < 0.3


def test_a_declared_rest_shows_the_offset_and_a_taper_does_not():
    rng = np.random.default_rng(0)
    time_s = np.arange(3000.0)
    current_A = np.where(time_s < 1800, 0.15, 0.15 + 0.3 * np.exp(-(time_s - 1800) / 900))
    current_A[:600] = -3.0
    noisy_A = current_A + 0.01 * rng.standard_normal(time_s.size)
    battery = replace(generic_battery("nmc", 12.0, 3), idle_current_A=0.0)
    (samples,) = samples_of(Log("rest", time_s, noisy_A, np.full(time_s.size, 11.4)), battery)
    assert len(samples.rests) >= 1
    assert [rest.excess_A for rest in samples.rests] == pytest.approx([0.15] * len(samples.rests), abs=0.005)


def pauses(rest_A: float, standby_A: float = 0.0) -> Log:
    """A drive that pauses for half a minute in every two, and stands with a small load for the last ten minutes."""
    rng = np.random.default_rng(1)
    time_s = np.arange(3600.0)
    current_A = np.where(time_s % 120 < 30, 0.0, -3.0 + rng.uniform(-1.0, 1.0, time_s.size))
    current_A[-600:] = standby_A
    return Log("pauses", time_s, current_A + rest_A, np.full(time_s.size, 11.4))


def test_pauses_of_a_drive_show_the_offset_and_a_steady_small_load_does_not():
    battery = replace(generic_battery("nmc", 12.0, 3), idle_current_A=0.0)
    (samples,) = samples_of(pauses(0.05, standby_A=-0.4), battery)
    assert len(samples.rests) >= 20
    assert [rest.excess_A for rest in samples.rests] == pytest.approx([0.05] * len(samples.rests), abs=1e-9)
    (undeclared,) = samples_of(pauses(0.05), replace(battery, idle_current_A=None))
    assert not undeclared.rests
