"""The compiled step with sensitivities against the model alone, and against central differences."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.sensitivities import CircuitAlong, CircuitSample, SensitiveCircuit
from ohmward.battery.models.thevenin import Corrections, Thevenin, without_curve
from ohmward.logs import Log
from ohmward_lab.simulate.voltage import simulate_voltage

#: A circuit in which every parameter acts.
RICH = Thevenin(
    capacity_Ah=2.0,
    ocv=OcvCurve((3.0, 3.5, 3.6, 4.2), (0.03, 0.02, 0.02, 0.03), (1e-4, -2e-4, 0.0, 1e-4)),
    r0_discharge_ohm=(0.05, 0.03),
    r0_charge_ohm=(0.06, 0.035),
    r_ohm=((0.03, 0.02), (0.05, 0.02)),
    tau_s=(20.0, 600.0),
    coulombic_efficiency=0.97,
    activation_K=2000.0,
    pair_activation_K=3000.0,
    tau_activation_K=1000.0,
    empty_activation_K=5000.0,
    transfer_V=0.1,
    net_charge_hysteresis=True,
    hysteresis_activation_K=500.0,
    tested_branch=-0.7,
)
ALL = Corrections(efficiency=1, ohmic=5, pair=10, tau=2, activation=2, empty_activation=1, hysteresis=1, offset=1)
#: Typical corrections of each kind.
SCALES = np.repeat([0.01, 0.2, 0.2, 0.2, 500.0, 1000.0, 0.2, 0.05], ALL)
T, GAP = 1200, 700


def record() -> CircuitSample:
    """Loads and charges between 95 and 20 % at 0 to 30 degC; between two samples an hour is not known."""
    rng = np.random.default_rng(0)
    mean_A = np.repeat(rng.uniform(-6.0, 2.5, T // 20), 20)
    dt_s, counted, moved = np.full(T, 3.0), np.ones(T), np.zeros(T)
    start_V, start_h = np.zeros((T, 2)), np.zeros((T, 3))
    dt_s[0], dt_s[GAP] = 0.0, 3600.0
    mean_A[[0, GAP]], counted[[0, GAP]] = 0.0, 0.0
    moved[GAP] = 0.1
    start_V[[0, GAP]] = [[0.01, -0.02], [-0.01, 0.01]]
    start_h[[0, GAP]] = [-0.2, 0.1, 0.4]
    degC = 15.0 + 15.0 * np.sin(np.arange(T) / 200.0)
    return CircuitSample(dt_s, mean_A, np.roll(mean_A, -1), degC, counted, moved, np.full(T, 0.02), start_V, start_h)


def along(model: Thevenin, theta: np.ndarray, soc: float = 0.95, sample: CircuitSample | None = None) -> CircuitAlong:
    return SensitiveCircuit(model, ALL).along(theta, soc, sample or record())


def test_without_corrections_the_voltage_is_that_of_the_model() -> None:
    rng = np.random.default_rng(1)
    current_A = np.repeat(rng.uniform(-4.0, 3.0, 60), 10)
    time_s, degC = 2.0 * np.arange(600), np.linspace(0.0, 30.0, 600)
    log = Log("drive", time_s, current_A, np.zeros(600), degC)
    expected_V = simulate_voltage(RICH, log, 0.9, hysteresis=-0.5).voltage_V
    mean_A = 0.5 * (current_A + np.concatenate([current_A[:1], current_A[:-1]]))
    mean_degC = 0.5 * (degC + np.concatenate([degC[:1], degC[:-1]]))
    first = (np.arange(600) > 0).astype(float)
    start_h = np.zeros((600, 3))
    start_h[0] = -0.5
    # the model takes the mean temperature of an interval, a log the one at its end
    at_end = CircuitSample(np.r_[0.0, np.diff(time_s)], mean_A, current_A, degC, first, 0.0, 0.0, np.zeros(2), start_h)
    found_V = along(RICH, np.zeros(sum(ALL)), 0.9, at_end).voltage_V
    assert found_V == pytest.approx(expected_V, abs=float(np.abs(degC - mean_degC).max()) * 1e-3)
    steady = at_end._replace(temperature_degC=np.full(600, 10.0))
    at_10 = simulate_voltage(RICH, replace(log, temperature_degC=np.full(600, 10.0)), 0.9, hysteresis=-0.5).voltage_V
    assert along(RICH, np.zeros(sum(ALL)), 0.9, steady).voltage_V == pytest.approx(at_10, abs=1e-12)


@pytest.mark.parametrize("net_charge", [True, False], ids=["net charge", "throughput"])
def test_the_columns_are_central_differences(net_charge: bool) -> None:
    model = replace(RICH, net_charge_hysteresis=net_charge)
    theta = 0.5 * SCALES * np.random.default_rng(2).standard_normal(sum(ALL))
    found = along(model, theta)
    for k in np.flatnonzero(np.repeat(np.array(Corrections._fields) != "efficiency", ALL))[:-1]:
        difference_V, _ = differences(model, theta, k)
        assert found.voltage_columns[:, k] == pytest.approx(difference_V, rel=1e-5, abs=1e-8 / SCALES[k])


@pytest.mark.parametrize("k", [0, sum(ALL) - 1], ids=["efficiency", "offset"])
def test_what_moves_the_charge_acts_at_its_soc_and_through_the_curve(k: int) -> None:
    """Of resistances and a hysteresis that do not depend on SoC all of the derivative is the sum of the two."""
    even = replace(
        RICH,
        ocv=OcvCurve(RICH.ocv.voltage_V, (0.02,) * 4),
        r0_discharge_ohm=(0.04, 0.04),
        r0_charge_ohm=(0.05, 0.05),
        r_ohm=((0.03, 0.03), (0.05, 0.05)),
        empty_activation_K=0.0,
    )
    theta = np.zeros(sum(ALL))
    found = along(even, theta)
    difference_V, difference = differences(even, theta, k)
    step = 1e-6
    slope_V = (even.ocv.mean_V(found.soc + step, 25.0) - even.ocv.mean_V(found.soc - step, 25.0)) / (2 * step)
    moving = SensitiveCircuit(even, ALL).moving.tolist()
    assert moving == [0, sum(ALL) - 1]
    of_soc = found.soc_columns[:, moving.index(k)]
    assert of_soc == pytest.approx(difference, abs=1e-7 / SCALES[k])
    whole_V = found.voltage_columns[:, k] + slope_V * of_soc
    # where the current changes its sign within the step of the difference, the resistance jumps
    wrong = np.abs(whole_V - difference_V) > 1e-5 * np.abs(difference_V).max()
    assert np.count_nonzero(wrong) <= 2


def differences(model: Thevenin, theta: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of voltage and SoC by a correction."""
    step = np.zeros(theta.size)
    step[k] = 1e-6 * SCALES[k]
    above, below = along(model, theta + step), along(model, theta - step)
    return (above.voltage_V - below.voltage_V) / (2 * step[k]), (above.soc - below.soc) / (2 * step[k])


def test_the_columns_of_the_start_are_central_differences() -> None:
    theta, step, sample = 0.5 * SCALES * np.random.default_rng(3).standard_normal(sum(ALL)), 1e-5, record()
    found = along(RICH, theta)
    for j in range(2):
        differences_V = []
        for at in (0, GAP):
            above, below = sample.start_V.copy(), sample.start_V.copy()
            above[at, j] += step
            below[at, j] -= step
            high, low = (along(RICH, theta, sample=sample._replace(start_V=start)) for start in (above, below))
            differences_V.append((high.voltage_V - low.voltage_V) / (2 * step))
        of_start = found.voltage_columns[:, sum(ALL) + j]
        assert of_start[:GAP] == pytest.approx(differences_V[0][:GAP], abs=1e-9)
        assert of_start[GAP:] == pytest.approx(differences_V[1][GAP:], abs=1e-9)
        # of the voltage at the start this is left after the gap
        assert of_start[GAP:] * found.left[GAP, j] == pytest.approx(differences_V[0][GAP:], abs=1e-9)


def test_the_hysteresis_of_both_starts_is_that_of_two_runs() -> None:
    theta, sample = np.zeros(sum(ALL)), record()
    low, high = (
        along(RICH, theta, sample=sample._replace(start_h=np.repeat(sample.start_h[:, [k]], 3, axis=1))).voltage_V
        for k in (0, 2)
    )
    assert along(RICH, theta).hysteresis_V == pytest.approx(high - low, abs=1e-12)


def test_the_circuit_without_its_curve_lacks_the_curve_alone() -> None:
    theta = 0.5 * SCALES * np.random.default_rng(2).standard_normal(sum(ALL))
    whole, bare = along(RICH, theta), along(without_curve(RICH), theta)
    curve_V = RICH.ocv.mean_V(whole.soc, record().temperature_degC)
    assert whole.voltage_V - bare.voltage_V == pytest.approx(curve_V, abs=1e-12)
