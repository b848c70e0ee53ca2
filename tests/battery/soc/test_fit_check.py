"""A battery file that does not fit the log is named, and one that fits is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ohmward import SocEstimator, generic_battery, identify, make_robot_day
from ohmward.battery.battery import Battery
from ohmward.battery.log_check import full_under_load
from ohmward.battery.models.noise import CurrentSensor
from ohmward.battery.soc.estimator import SocRun
from ohmward.battery.soc.fit_check import (
    DO_NOT_TRUST,
    LARGEST,
    given_after_empty,
    lasting_error,
    misfits,
    moved_uncounted,
)
from ohmward.battery.soc.sample import SocEstimate, SocFlag
from ohmward.errors import InputError
from ohmward.logs.log import Log, Note

LABELS = {"lfp": generic_battery("lfp", 12.0, 4), "lead-acid": generic_battery("lead-acid", 12.0, 6)}


def judged(battery: Battery, log: Log, filter: str = "default") -> tuple[SocRun, tuple[Note, ...]]:
    """The run over a log, and the verdict on the file."""
    run = SocEstimator(battery, filter=filter).run(log)
    return run, misfits(battery, log, run.settings, run.estimates)


@pytest.fixture(scope="module")
def tested() -> Battery:
    return identify(make_robot_day("lfp").pulse_test, capacity_Ah=12, chemistry="lfp", n_series=4)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("chemistry", LABELS)
def test_the_file_of_the_battery_fits(chemistry, seed):
    run, found = judged(LABELS[chemistry], make_robot_day(chemistry, seed).mission)
    assert found == ()
    assert "misfit" not in run.counts()


def test_the_tested_battery_fits(tested):
    _, found = judged(tested, make_robot_day("lfp").mission)
    assert found == ()


def test_a_file_of_another_chemistry_does_not_fit(tested):
    _, (note,) = judged(tested, make_robot_day("lead-acid").mission)
    assert note.level == "warning"
    assert "does not fit" in note.text


def test_a_current_of_the_wrong_sign_does_not_fit(tested):
    day = make_robot_day("lfp").mission
    assert judged(tested, replace(day, current_A=-day.current_A))[1]


def test_a_current_in_another_unit_does_not_fit(tested):
    day = make_robot_day("lfp").mission
    assert judged(tested, replace(day, current_A=3.0 * day.current_A))[1]


def test_an_impossible_offset_is_flagged_live(tested):
    estimator = SocEstimator(tested, 0.5, 0.01)
    offset_A = 0.25 * tested.capacity_Ah
    hours = _rest(tested, hours=5.0, current_A=offset_A)
    flags = [
        estimator.update(*sample).flags for sample in zip(hours.time_s, hours.current_A, hours.voltage_V, strict=True)
    ]
    assert flags[0] == 0
    assert flags[-1] & SocFlag.MISFIT


LFP = LABELS["lfp"]


@pytest.mark.parametrize(
    ("current_A", "cell_V", "step_s", "found"),
    [(-2.0, 3.65, 20.0, True), (-2.0, 3.4, 20.0, False), (2.0, 3.65, 20.0, False), (-2.0, 3.65, 1.0, False)],
)
def test_a_load_holds_no_battery_above_its_curve(current_A, cell_V, step_s, found):
    """A tenth of the capacity of 12 Ah, or less."""
    log = Log("steady", step_s * np.arange(120.0), np.full(120, current_A), np.full(120, 4 * cell_V))
    assert ("another chemistry" in full_under_load(log, LFP)) == found


def test_the_charge_of_an_empty_battery_is_counted():
    time_s = np.arange(0.0, 3600.0, 10.0)
    log = Log("steady", time_s, np.full(360, -2.4), np.full(360, 12.8))
    soc = np.where(time_s < 1800.0, 0.5, 0.0)
    estimates = SocEstimate(*[soc] * len(SocEstimate._fields))
    assert given_after_empty(LFP, log.charge_Ah(), estimates) == pytest.approx(0.1, rel=0.01)


def test_a_run_says_that_its_battery_does_not_fit(tested):
    log = _rest(tested, hours=1.0, current_A=0.0)
    run = SocEstimator(generic_battery("nmc", 12.0, 5)).run(log)
    assert "another number of cells" in str(run.notes[0])
    assert run.explain().sentence.startswith(DO_NOT_TRUST)
    assert SocEstimator(tested, 0.5).run(log).notes == ()


@pytest.mark.parametrize(
    ("n_series", "factor", "unit"), [(8, 1.0, r"voltage=mV"), (4, 1e3, r"current=mA.*units=\{'current': 'mA'\}")]
)
def test_a_run_refuses_a_log_that_cannot_be_of_its_battery(tested, n_series, factor, unit):
    log = _rest(tested, hours=1.0, current_A=-2.0)
    log = replace(log, current_A=factor * log.current_A)
    with pytest.raises(InputError, match=rf"is it a log of another battery.*{unit}"):
        SocEstimator(generic_battery("lfp", 12.0, n_series)).run(log)


def test_a_sensor_without_an_error_is_no_misfit(tested):
    exact = replace(tested, sensor=CurrentSensor(offset_std_A=0.0, offset_walk_A=0.0))
    estimator = SocEstimator(exact, 0.5)
    log = _rest(tested, hours=0.5, current_A=0.0)
    run = estimator.run(log)
    assert not misfits(exact, log, run.settings, run.estimates)
    assert not np.any(run.estimates.flags.astype(int) & SocFlag.MISFIT)


def moved(soc, std=0.05, current_A=0.0, flags=0.0, offset_std_A=0.0, offset_A=0.0, duration_s=60.0):
    """What `moved_uncounted` finds in estimates (T,) of a battery of 1 Ah."""
    T = len(soc)
    log = Log("moved", np.linspace(0.0, duration_s, T), np.full(T, current_A), np.full(T, 3.7))
    values = {"soc": soc, "soc_std": std, "flags": flags}
    estimates = SocEstimate(*(np.broadcast_to(values.get(name, 0.0), T) for name in SocEstimate._fields))
    return moved_uncounted(
        log.time_s, log.charge_Ah(), estimates, 1.0, CurrentSensor(1.0, offset_std_A=offset_std_A, offset_A=offset_A)
    )


def test_a_charge_that_moves_by_itself_is_measured_in_its_deviations_before():
    assert moved([0.9, 0.9, 0.6], std=[0.05, 0.05, 0.2]) == pytest.approx(6.0)


def test_the_band_may_narrow_and_the_charge_be_counted():
    assert moved([0.9, 0.7, 0.6], std=[0.2, 0.1, 0.05]) == pytest.approx(1.5)
    assert moved([0.90, 0.95], current_A=3.0) == pytest.approx(0.0, abs=1e-9)  # for a minute


def test_an_offset_within_its_deviation_moves_the_charge():
    assert moved([0.9, 0.8], std=0.05, offset_std_A=0.05, duration_s=7200.0) == pytest.approx(0.1 / np.hypot(0.05, 0.1))


def test_the_offset_in_the_file_is_no_charge():
    assert moved([0.9, 0.9], current_A=0.02, offset_A=0.02, duration_s=7200.0) == pytest.approx(0.0, abs=1e-9)


def test_estimates_before_and_after_a_gap_are_not_compared():
    assert moved([0.9, 0.9, 0.2, 0.2], flags=[0.0, 0.0, SocFlag.GAP, 0.0]) == 0.0


def test_errors_over_those_that_are_expected():
    rng = np.random.default_rng(3)
    white = rng.normal(size=6000)
    assert lasting_error(*_run(white, 1.0)) == pytest.approx(1.0, abs=0.03)
    assert lasting_error(*_run(white, 0.5)) == pytest.approx(2.0, abs=0.06)
    assert lasting_error(*_run(np.full(6000, 0.7), 1.0)) == pytest.approx(0.7)
    assert np.isnan(lasting_error(*_run(white[:99], 1.0)))


@pytest.mark.parametrize(("share", "misfit"), [(0.003, False), (0.02, False), (0.2, True), (1.0, True)])
def test_errors_count_by_the_time_they_last_and_not_by_their_size(share, misfit):
    rng = np.random.default_rng(4)
    spiked = np.where(rng.random(6000) < share, 1000.0, 0.5 * rng.normal(size=6000))
    assert (lasting_error(*_run(spiked, 1.0)) > 1.0) == misfit
    assert lasting_error(*_run(spiked, 1.0)) <= LARGEST


def test_the_shape_of_the_voltage_tells_the_number_of_cells():
    """The day of four cells lies between the voltages of five that are nearly empty too."""
    day = make_robot_day("lfp").mission
    _, (note,) = judged(generic_battery("lfp", 12.0, 5), day)
    assert "4 cells in series explain its voltage better than 5, the n_series of the battery file" in note.text


@pytest.mark.parametrize(("capacity_Ah", "named"), [(7.0, "1.5 times"), (15.0, ""), (20.0, "0.58 times")])
def test_the_voltage_tells_another_capacity_but_not_an_aged_one(capacity_Ah, named):
    """A day of 12 Ah."""
    _, found = judged(generic_battery("lfp", capacity_Ah, 4), make_robot_day("lfp").mission, "coulomb")
    assert len(found) == bool(named)
    assert all(f"{named} the file's capacity explains its voltage better" in note.text for note in found)


def test_another_number_of_cells_is_named_for_every_filter():
    day = make_robot_day("lfp").mission
    _, (note,) = judged(generic_battery("lfp", 12.0, 5), day, "coulomb")
    assert "4 cells" in note.text


def test_filters_without_errors_as_states_are_not_judged(tested):
    _, found = judged(tested, make_robot_day("lead-acid").mission, "textbook-ukf")
    assert found == ()


def _rest(battery: Battery, hours: float, current_A: float) -> Log:
    """A battery at rest at half charge while its sensor shows a current."""
    time_s = np.arange(0.0, 3600.0 * hours, 10.0)
    voltage_V = float(
        np.interp(0.5, np.linspace(0, 1, len(battery.thevenin.ocv.voltage_V)), battery.thevenin.ocv.voltage_V)
    )
    return Log("rest", time_s, np.full(len(time_s), current_A), np.full(len(time_s), voltage_V))


def _run(innovation_V: np.ndarray, std_V: float) -> tuple[np.ndarray, SocEstimate]:
    n = len(innovation_V)
    columns = {name: np.ones(n) for name in SocEstimate._fields}
    columns |= {"innovation_V": innovation_V, "voltage_std_V": np.full(n, std_V)}
    return 10.0 * np.arange(n), SocEstimate(**columns)
