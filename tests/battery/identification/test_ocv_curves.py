import numpy as np
import pytest

from battery.identification.examples import LFP_OCV, NMC_OCV, cell, low_rate_logs, play, steps
from ohmward.battery.identification.ocv_from_logs import (
    RestPoint,
    branch_note,
    find_branches,
    monotone,
    ocv_from_branches,
    ocv_from_rests,
)
from ohmward.battery.identification.record import make_records
from ohmward.errors import InputError
from ohmward.logs import Log

SOC = np.linspace(0.05, 0.95, 40)


def branches_of(*logs, capacity_Ah=2.0, initial_soc=None):
    return tuple(
        b for log in logs for r in make_records(log, capacity_Ah) for b in find_branches(r, capacity_Ah, initial_soc)
    )


def test_both_branches_give_mean_and_half_gap():
    p = cell(LFP_OCV, hysteresis_rate=100.0)
    ocv = ocv_from_branches(branches_of(*low_rate_logs(p)), 25.0)
    assert ocv.mean_V(SOC, 25.0) == pytest.approx(np.asarray(LFP_OCV.mean_V(SOC, 25.0)), abs=1e-3)
    overpotential_V = 0.065 * 2.0 / 30
    assert ocv.hysteresis_at(SOC) == pytest.approx(0.015 + overpotential_V, abs=1e-3)


def test_one_direction_is_the_curve_without_hysteresis():
    down, _ = low_rate_logs(cell())
    ocv = ocv_from_branches(branches_of(down), 25.0)
    assert not any(ocv.hysteresis_V)
    assert ocv.mean_V(SOC, 25.0) == pytest.approx(np.asarray(NMC_OCV.mean_V(SOC, 25.0)), abs=0.006)


def test_complete_branches_define_their_own_axis():
    branches = branches_of(*low_rate_logs(cell()), capacity_Ah=2.08)
    assert [b.complete for b in branches] == [True, True]
    assert branches[0].soc[[0, -1]] == pytest.approx([1, 0], abs=1e-9)
    levels = [branch_note(branch, 2.08).level for branch in branches]
    assert levels == ["warning", "warning"]
    assert "-3.8% of the given capacity" in branch_note(branches[0], 2.08).text
    assert [branch_note(branch, 2.02).level for branch in branches] == ["info", "info"]


def test_part_of_a_branch_needs_its_start():
    log = play(cell(), *steps([(600, 0, 60), (12 * 3600, -2 / 20, 60)]), soc=0.8)
    with pytest.raises(InputError, match=r"where it starts is not known; give the SoC.*--initial-soc 0\.5"):
        branches_of(log)
    (branch,) = branches_of(log, initial_soc=0.8)
    assert branch.soc[[0, -1]] == pytest.approx([0.8, 0.2], abs=1e-3)


def test_charge_that_ends_at_the_limit_after_a_full_discharge_is_complete():
    """The current sensor loses 13 % in charging; the voltage limit says that the battery is full all the same."""
    C = 2.0
    phases = [(600, 0, 60), (30 * 3600, -C / 30, 60), (3600, 0, 60), (30 * 3600, C / 30, 60), (3600, 0, 60)]
    log = play(cell(), *steps(phases), soc=1.0)
    seen_A = np.where(log.current_A > 0, 0.87 * log.current_A, log.current_A)
    branches = branches_of(Log("lossy", log.time_s, seen_A, log.voltage_V))
    assert [b.complete for b in branches] == [True, True]
    assert branches[1].soc[-1] == pytest.approx(1.0)


def test_change_with_temperature():
    def at(degC, shift_V):
        return [
            Log(f"{log.name}{degC}", log.time_s, log.current_A, log.voltage_V + shift_V, np.full(len(log), degC))
            for log in low_rate_logs(cell())
        ]

    ocv = ocv_from_branches(branches_of(*at(5.0, -0.004), *at(25.0, 0.0), *at(45.0, 0.004)), 25.0)
    assert ocv.reference_degC == 25.0
    assert np.array(ocv.temperature_V_per_K) == pytest.approx(0.0002, abs=1e-5)
    assert ocv.mean_V(0.5, 45.0) - ocv.mean_V(0.5, 25.0) == pytest.approx(0.004, abs=1e-4)


def points(soc, duration_s=3600.0):
    return [RestPoint(s, float(NMC_OCV.mean_V(s, 25.0)), duration_s) for s in soc]


def test_curve_through_rests():
    ocv = ocv_from_rests(points(np.linspace(0, 1, 11)), 3.0, 25.0)
    assert ocv.mean_V(SOC, 25.0) == pytest.approx(np.asarray(NMC_OCV.mean_V(SOC, 25.0)), abs=0.02)
    nodes = np.linspace(0, 1, 11)
    assert ocv.mean_V(nodes, 25.0) == pytest.approx(np.asarray(NMC_OCV.mean_V(nodes, 25.0)), abs=1e-6)


def test_rests_that_do_not_reach_the_ends():
    ocv = ocv_from_rests(points(np.linspace(0.15, 0.9, 8)), 3.0, 25.0)
    assert ocv.voltage_V[-1] == pytest.approx(float(NMC_OCV.mean_V(1.0, 25.0)), abs=0.03)
    assert 2.9 < ocv.voltage_V[0] < float(NMC_OCV.mean_V(0.15, 25.0))


def test_longer_rests_count_more():
    short = [RestPoint(1.0, 5.0, 600.0)]
    ocv = ocv_from_rests(points([0.0, 0.5, 1.0], 60000.0) + short, 3.0, 25.0)
    assert ocv.voltage_V[-1] == pytest.approx(float(NMC_OCV.mean_V(1.0, 25.0)), abs=0.02)


@pytest.mark.parametrize("soc", [[], [0.5], [0.5, 0.6]])
def test_too_few_rests_are_refused(soc):
    with pytest.raises(InputError, match="open-circuit voltage cannot be separated"):
        ocv_from_rests(points(soc), 3.0, 25.0)


def test_monotone_leaves_rising_values_alone_and_splits_a_dip():
    rising = np.array([1.0, 2.0, 2.0, 5.0])
    assert monotone(rising) == pytest.approx(rising)
    dipped = monotone(np.array([1.0, 3.0, 2.0, 4.0]))
    assert dipped == pytest.approx([1.0, 2.5, 2.5, 4.0])
    assert monotone(np.array([1.0, 3.0, 2.0, 4.0]), np.array([1.0, 1.0, 0.5, 1.0])) == pytest.approx([1, 2.2, 2.2, 4])
