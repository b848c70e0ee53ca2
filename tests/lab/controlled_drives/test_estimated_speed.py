"""Slip control on an estimated speed, in MuJoCo: sensors as robots have them, friction taken for 0.5 by all."""

from functools import cache

import numpy as np
import pytest

from ohmward.traction.control import SlipCommand, SlipController
from ohmward_lab.simulate.ground import Patch
from ohmward_lab.simulate.mujoco_plant import RlmaParameters
from ohmward_lab.traction.compared_slip_laws import SlipPid
from scripts import script

pytest.importorskip("mujoco", reason="the plant needs MuJoCo: pip install mujoco")
loops, peers = script("slip_loops"), script("slip_peers")

IMU, EDGES = loops.Sensors(), loops.Sensors(edges=True)


@cache
def from_rest(friction, sensors, seed=1):
    control = loops.Stepper(SlipController(loops.WHEEL, loops.WIDER, loops.LIMITS), lambda _: SlipCommand(0.12))
    plant = loops.RlmaPlant(RlmaParameters(), [Patch(friction=friction)])
    return loops.observed_run(control, plant, 1.0, sensors, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("friction", "arrival_s"), [(0.2, 0.5), (0.8, 0.5)])
def test_the_slip_arrives_and_stays_whatever_the_friction(friction, arrival_s, seed):
    found = loops.tracking(from_rest(friction, IMU, seed).truth, 0.12, 0.5)
    assert found.settled_s <= arrival_s
    assert found.rms <= 0.012


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("friction", [0.2, 0.8])
def test_with_the_time_of_edges_it_is_there_after_0_3_s(friction, seed):
    found = loops.tracking(from_rest(friction, EDGES, seed).truth, 0.12, 0.5)
    assert found.settled_s <= 0.3
    assert found.rms <= 0.01


@pytest.mark.slow
@pytest.mark.parametrize("sensors", [IMU, EDGES, loops.Sensors(passive=True)])
def test_the_sigma_of_the_speed_holds_in_closed_loop(sensors):
    found = [from_rest(friction, sensors, seed) for friction in (0.2, 0.8) for seed in (1, 2)]
    errors = [o.estimate.speed_m_s[-1] - o.truth.speed_m_s[-1] for o in found]
    creep_of_passive_wheels = 0.004  # they roll by slipping: not in the model
    stds = [o.estimate.speed_std_m_s[-1] + creep_of_passive_wheels for o in found]
    assert np.abs(np.divide(errors, stds)).max() < 3.0


@pytest.mark.slow
def test_a_slope_that_no_sensor_was_told_of_is_found():
    pitch_is_wrong = loops.Sensors(pitch_std_deg=1.0)
    found = loops.tracking(from_rest(0.2, pitch_is_wrong).truth, 0.12, 0.5)
    assert found.rms <= 0.012


@pytest.mark.slow
@pytest.mark.parametrize("passive", [False, True])
def test_the_claim_holds_for_masses_and_slopes_that_nobody_told(passive):
    rng, sensors = np.random.default_rng(21), loops.Sensors(passive=passive)
    runs = [peers.jumping(sensors, friction, rng, seed) for friction in (0.15, 0.35, 1.0) for seed in (1, 2)]
    error, std = np.concatenate(runs).T
    assert np.mean((error / std) ** 2) < 3.0  # of six drives; over many it is below 2
    assert np.mean(np.abs(error) <= 1.96 * std) > 0.85


@pytest.mark.slow
@pytest.mark.parametrize("tyre", peers.TYRES)
@pytest.mark.parametrize("friction", [0.15, 1.0])
def test_a_spin_ends_on_an_estimated_speed(tyre, friction):
    launch = SlipController(loops.WHEEL, loops.WIDER, loops.LIMITS).launch
    found = peers.held(loops.WIDER, launch, tyre, friction, EDGES, 1, peers.SPIN_S)
    assert found.settled_s <= found.least_s + 0.15
    plain = peers.held(SlipPid(10.0, 1000.0), 1.0, tyre, friction, EDGES, 1, peers.SPIN_S)
    assert found.step_Nm <= plain.step_Nm


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_an_edge_is_as_old_as_the_wheel_turned_since(way):
    ground = loops.RlmaPlant(RlmaParameters()).reset()
    speed, turning, age_s = 2.0, 300.0, 0.37e-3
    angle = lambda t: way * (speed * t + 0.5 * turning * t**2)  # noqa: E731
    before, now = (
        ground._replace(wheel_angle_rad=np.full(4, angle(t)), wheel_speed_rad_s=np.full(4, way * (speed + turning * t)))
        for t in (0.0, loops.DT)
    )
    assert loops.age_s(before, now, 0, angle(loops.DT - age_s), way) == pytest.approx(age_s, abs=1e-7)
    assert np.isnan(loops.age_s(before, now, 0, 0.0, 0.0))


def test_reversals_count_swings_of_more_than_a_size():
    time = np.linspace(0.0, 1.0, 1000)
    assert loops.reversals(np.sin(2 * np.pi * 5 * time), 0.1) == 10
    assert loops.reversals(0.04 * np.sin(2 * np.pi * 5 * time) + time, 0.1) == 0
