"""What everybody runs is what our filters run."""

import numpy as np
import pytest

from ohmward.battery.models.ocv import OcvCurve
from scripts import script

workloads = script("workloads")


def test_the_curve_is_that_of_our_table():
    problem = workloads.cell_problem("ekf", 10)
    soc = np.linspace(-0.2, 1.2, 97)
    x = np.column_stack([soc, np.zeros((97, 2))])
    expected = OcvCurve(workloads.OCV_V).mean_V(soc, 25.0)
    np.testing.assert_allclose(problem.voltage(np, x, 0.0), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("hysteresis", [False, True])
def test_the_slope_is_that_of_the_voltage(hysteresis):
    problem = workloads.cell_problem("ekf", 10, hysteresis)
    x = np.array([0.437, 0.01, -0.02, 0.3][: problem.n])
    step = 1e-6 * np.eye(problem.n)
    differences = [(problem.voltage(np, x + d, 1.0) - problem.voltage(np, x - d, 1.0)) / 2e-6 for d in step]
    np.testing.assert_allclose(problem.slope(np, x), differences, rtol=1e-7)


def test_hysteresis_follows_the_current_and_stays_without():
    problem = workloads.cell_problem("ekf", 10, hysteresis=True)
    x = np.array([0.5, 0.0, 0.0, 0.2])
    assert problem.next_state(np, x, 0.0)[3] == 0.2
    assert problem.next_state(np, x, 1e9)[3] == 1.0
    assert problem.next_state(np, x, -1e9)[3] == -1.0


def test_the_drive_gives_back_what_it_took():
    drive = workloads.make_drive(4000)
    assert abs(drive.current_A.sum()) < 0.02 * np.abs(drive.current_A).sum()
    assert (drive.voltage_V > 3.5).all() and (drive.voltage_V < 4.3).all()


def test_disagreement_counts_in_sigmas():
    reference = workloads.Posterior(np.zeros(2), np.diag([4.0, 1.0]))
    found = workloads.Posterior(np.array([0.2, 0.0]), np.diag([4.0, 1.0]))
    assert workloads.disagreement(found, reference) == pytest.approx(0.1)
    found = workloads.Posterior(np.zeros(2), np.array([[4.0, 0.5], [0.5, 1.0]]))
    assert workloads.disagreement(found, reference) == pytest.approx(0.25)
