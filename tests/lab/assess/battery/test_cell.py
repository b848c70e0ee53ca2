"""A cell of the study of batteries: figures by hand, and what an estimator gives."""

import math

import numpy as np
import pytest

from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.sample import SocSample
from ohmward.logs import Log
from ohmward_lab.assess.battery import BASE, CONDITIONS, METHODS, figures, identified, measured, soc_cell

BY_NAME = {method.name: method for method in METHODS}


def test_figures_by_hand():
    time_s = np.array([0.0, 3000.0, 3600.0, 7200.0])
    error = np.array([[0.2, 0.2], [0.1, 0.1], [0.03, 0.1], [-0.04, 0.2]])
    std = np.array([[0.1, 0.1], [0.1, 0.1], [0.02, 0.02], [0.01, np.nan]])
    rmse, largest, covered, found_min, lost = figures(time_s, error, std)
    assert rmse == pytest.approx(math.sqrt((0.03**2 + 0.04**2 + 0.1**2 + 0.2**2) / 4))
    assert largest == 0.2 and covered == pytest.approx(1 / 3) and lost == 0.5
    assert found_min == math.inf  # the median of 60 minutes and never
    assert figures(time_s, error[:, :1], std[:, :1])[3] == 60.0


def test_a_cell_is_what_the_estimator_gives():
    condition, runs = BASE._replace(factor="x"), 2
    samples, truth = measured("nca", condition, runs, 3)
    errors = []
    for run, sign in enumerate((-1.0, 1.0)):
        log = Log("shift", np.cumsum(samples.dt_s), *(values[:, run] for values in samples[1:]))
        start = min(float(truth[0, run]) + sign * 0.05, 1.0)
        errors.append(SocEstimator(BY_NAME["ekf"].make(identified("nca")), start).run(log).soc - truth[:, run])
    found = soc_cell("nca", condition, BY_NAME["ekf"], runs, 3)
    late = np.cumsum(samples.dt_s) >= 3600.0
    assert found.rmse == pytest.approx(np.sqrt(np.mean(np.square(errors)[:, late])), rel=1e-6)


def test_an_offset_of_the_sensor_misleads_counting_by_its_charge():
    offset = next(c for c in CONDITIONS if c.name == "current offset: 5 % of C")
    condition = offset._replace(start_error=0.0, gain=0.0)
    found = soc_cell("nca", condition, BY_NAME["coulomb"], 2, 1)
    assert found.largest == pytest.approx(8 * 0.05, abs=0.02)
    assert found.lost == 1.0 and found.found_min == math.inf


@pytest.mark.parametrize("method", ["coulomb", "[P] T2RC + UKF"])
def test_a_start_that_is_right_is_not_moved_by_the_first_voltage(method):
    laboratory = next(c for c in CONDITIONS if c.factor == "laboratory")
    assert soc_cell("lfp", laboratory, BY_NAME[method], 2, 1).rmse < 0.002  # 1 point and more where it is


def test_the_filter_of_P_starts_full_whatever_it_is_given():
    method, conditions = BY_NAME["[P] RC + KF"], [BASE._replace(start_error=error) for error in (0.3, 0.05)]
    far, near = (soc_cell("nca", condition, method, 2, 1) for condition in conditions)
    assert far.rmse == near.rmse
    first = SocSample(0.0, 0.0, 12.0, 25.0)
    state = method.make(identified("nca")).init(first, 0.5)
    assert state.belief.mean[0] == pytest.approx(identified("nca").thevenin.ocv.voltage_V[-1])
