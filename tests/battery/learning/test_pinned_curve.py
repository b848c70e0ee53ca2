"""A learnt curve lies over the charge below full, so that it does not show the capacity."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.battery import Knowledge
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.learning.parameters import parameters_of, prior_covariance
from ohmward.battery.learning.voltage_model import CurvePlace, file_charge
from ohmward.battery.models.ocv import slip_shape
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.logs import Log
from ohmward_lab.simulate.voltage import simulate_voltage

LABEL = generic_battery("lfp", 10.0)
SOC = np.linspace(0.0, 1.0, 101)


def learnt(battery, capacity_std, seen_from_soc=0.1):
    """The battery as after logs down to this SoC that have left its capacity this uncertain."""
    p = parameters_of(battery)
    known = Knowledge.of(p.names, prior_covariance(battery), (), seen_from_soc)
    narrow = tuple(0.02 for _ in battery.noise.model_std_V)
    noise = replace(battery.noise, capacity_std=capacity_std, model_std_V=narrow, soc_axis_std=0.01)
    return replace(battery, noise=noise, knowledge=known)


def test_a_battery_without_logs_slips_as_its_electrodes_do():
    assert LABEL.pinned is LABEL


@pytest.mark.parametrize("seen_from_soc", [0.1, 0.25])
def test_the_curve_moves_with_an_unknown_capacity_as_in_learning(seen_from_soc):
    loss = 1e-3
    pinned = learnt(LABEL, 1.0, seen_from_soc).pinned.thevenin
    moved = pinned.ocv_slip * slip_shape(SOC, pinned.ocv_slip)
    place = CurvePlace(seen_from_soc, -loss).at(file_charge(SOC, -loss))
    assert np.sqrt(np.mean((moved - (place - SOC) / loss) ** 2)) < 0.25  # of up to 1, as one factor on one shape


def test_a_battery_of_known_capacity_slips_as_its_electrodes_do():
    file = learnt(LABEL, 1e-6)
    assert file.pinned.thevenin.ocv_slip == pytest.approx(file.thevenin.ocv_slip)
    assert file.pinned.noise.ocv_slip_std == pytest.approx(file.noise.ocv_slip_std)


@pytest.mark.parametrize("share", [0.88, 1.0, 1.12])
def test_the_charge_is_covered_whatever_the_capacity_is(share):
    """The file counts 10 Ah and has the curve over them; the battery has another capacity."""
    ocv = LABEL.thevenin.ocv
    time_s = np.arange(0.0, 6 * 3600.0, 10.0)
    current_A = np.where(time_s % 600.0 < 400.0, -2.0, -0.2)
    true = replace(LABEL.thevenin, capacity_Ah=10.0 * share)
    log = Log("day", time_s, current_A, np.zeros(time_s.size), np.full(time_s.size, 25.0))
    found = simulate_voltage(true, log, 1.0)
    curve_V = np.asarray(ocv.mean_V(1.0 - (1.0 - SOC) / share, 25.0))
    counted = replace(
        LABEL.thevenin, ocv=replace(ocv, voltage_V=tuple(curve_V), hysteresis_V=(), temperature_V_per_K=())
    )
    file = learnt(replace(LABEL, thevenin=counted), 0.1)
    run = SocEstimator(file, initial_soc=1.0, initial_soc_std=0.01).run(replace(log, voltage_V=found.voltage_V))
    used = found.soc > 0.15
    assert np.mean(np.abs(run.soc - found.soc)[used] < 1.96 * run.soc_std[used]) > 0.95
