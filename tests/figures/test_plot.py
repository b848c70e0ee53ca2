"""A run of each kind has figures: what it estimated, with its band."""

import math

import numpy as np
import pytest

import ohmward
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.logs import DriveLog, Log
from ohmward.traction import RLMA, ROBOTINO, hard_terrain, scene
from ohmward.traction.speed_observer.estimator import SlipEstimator
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from ohmward.traction.speed_observer.states import States
from ohmward.traction.terrain.floor import Floor
from ohmward.traction.terrain.slip_on_floors import FloorSlipEstimator, slip_on_floors

T = 40
TIME_S = 0.02 * np.arange(T)
BATTERY = generic_battery("lfp", 12.0, n_series=4)


def titles(plot):
    return [figure.title for figure in plot.figures]


@pytest.mark.parametrize(("name", "others"), [("ekf", 3), ("coulomb", 0)])
def test_of_charge(name, others, tmp_path):
    voltage = np.full(T, 13.1)
    voltage[10:20] = np.nan
    run = SocEstimator(BATTERY, 0.5, filter=name, lowering="python").run(Log("x", TIME_S, np.full(T, -3.0), voltage))
    plot = run.plot()
    assert titles(plot)[0] == "State of charge" and len(plot.figures) == 1 + others
    band = plot.figures[0].bands[0]
    assert band.high - band.low == pytest.approx(2 * 100 * BAND_95 * run.soc_std)
    assert [span.label for span in plot.figures[0].spans] == ["no voltage"]
    plot.save(tmp_path / "soc.html")
    assert "State of charge" in (tmp_path / "soc.html").read_text(encoding="utf-8")


def test_of_slip():
    wheels = np.hstack([np.full((T, 2), 2.0), np.full((T, 2), math.nan)])
    observer = SpeedObserver(scene(RLMA, hard_terrain("gravel")), States(radius=False, rolling=False), method="ekf")
    run = SlipEstimator(observer, "python").run(DriveLog("x", TIME_S, wheels, np.full((T, 2), 0.2)))
    plot = run.plot()
    assert titles(plot) == ["Speed", "Slip, wheel 1", "Slip, wheel 2", "Friction over the assumed", "Grade"]
    assert plot.figures[0].series[0].y == pytest.approx(run.speed_m_s)


def test_of_slip_on_floors():
    carpet = Floor("carpet", friction=1.4, stiffness=3.0, rolling=0.1, roller=0.2)
    wheels, currents = np.tile([-2.0, 0.0, 2.0], (T, 1)), np.tile([-1.0, 0.0, 1.0], (T, 1))
    run = FloorSlipEstimator(slip_on_floors(ROBOTINO, [carpet], "ekf"), "python").run(
        DriveLog("x", TIME_S, wheels, currents)
    )
    plot = run.plot()
    assert titles(plot) == ["Slip of the robot", *(f"Floor under wheel {k}" for k in (1, 2, 3))]
    assert [s.label for s in plot.figures[1].series] == ["floor 0", "floor 1"]


def test_something_else_is_refused():
    with pytest.raises(InputError, match="what the run of an estimator returned, got dict"):
        ohmward.plot({})


def runs(*filters):
    log = Log("x", TIME_S, np.full(T, -3.0), np.full(T, 13.1))
    return [SocEstimator(BATTERY, 0.5, filter=name, lowering="python").run(log) for name in filters]


def test_runs_are_drawn_beside_each_other_and_a_truth():
    ekf, coulomb = runs("ekf", "coulomb")
    plot = ekf.plot(coulomb, truth=np.full(T, 0.5))
    assert titles(plot) == ["State of charge", "Error of the state of charge"]
    assert [s.label for s in plot.figures[0].series] == ["ekf, lfp 12 Ah", "coulomb, lfp 12 Ah", "reference"]


def test_a_run_beside_its_truth_keeps_its_band():
    (run,) = runs("ekf")
    plot = run.plot(truth=np.full(T, 0.5))
    assert titles(plot)[:2] == ["State of charge", "Error of the state of charge"] and len(plot.figures) == 5
    assert plot.figures[0].series[1].y == pytest.approx(np.full(T, 50.0)) and plot.figures[0].bands


def test_runs_of_other_kinds_or_lengths_are_refused():
    (run,) = runs("ekf")
    with pytest.raises(InputError, match="runs of one kind together, got SocRun, Log"):
        run.plot(Log("x", TIME_S, np.zeros(T), np.zeros(T)))
    with pytest.raises(InputError, match=r"runs over one log, and its truth: got \[39, 40\] samples"):
        run.plot(truth=np.zeros(T - 1))


def test_of_logs_and_batteries():
    log = Log("day", TIME_S, np.zeros(T), np.full(T, 13.0), np.full(T, 20.0))
    assert titles(log.plot()) == ["Current", "Voltage", "Temperature"]
    drive = DriveLog("d", TIME_S, np.ones((T, 4)), np.full((T, 2), np.nan), yaw_rate_rad_s=np.zeros(T))
    assert titles(drive.plot()) == ["Wheels", "Yaw rate"]
    assert titles(BATTERY.plot()) == ["Open-circuit voltage", "Resistances"]
