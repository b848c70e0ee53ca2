from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import start_model
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import ESTIMATORS, available, make_estimator
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.errors import InputError
from ohmward.logs import Log
from ohmward_lab.published.registry import PUBLISHED
from ohmward_lab.simulate.voltage import simulate_voltage

MODEL = start_model("nmc", 2.0)
BATTERY = Battery("cell", 2.0, thevenin=MODEL)
CURRENT_A = np.tile(np.repeat([0.0, -1.0, 0.5, -2.0], 60), 15)
TIME_S = np.arange(CURRENT_A.size, dtype=float)
BARE = Log("drive", TIME_S, CURRENT_A, np.full(TIME_S.size, 3.7))
SIMULATED = simulate_voltage(MODEL, BARE, 0.9)
LOG = replace(BARE, voltage_V=SIMULATED.voltage_V)


def test_a_battery_offers_all():
    assert available(BATTERY) == tuple(ESTIMATORS)
    assert available(BATTERY, with_published=True) == (*ESTIMATORS, *PUBLISHED)


def test_the_default():
    assert make_estimator("Default", BATTERY) == make_estimator("gsf", BATTERY)
    assert "gsf, lfp" in repr(SocEstimator(replace(BATTERY, chemistry="lfp")))
    with pytest.raises(InputError, match="filter must be one of default, ekf, ukf, gsf"):
        make_estimator("best", BATTERY)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_estimator_runs_streams_alike_and_stays_near_the_truth(name):
    estimator = make_estimator(name, BATTERY)
    run = SocEstimator(estimator, 0.9).run(LOG).estimates
    assert np.abs(run.soc - SIMULATED.soc).max() < 0.06
    assert np.isfinite(run.soc_std).all() and (run.soc_std > 0).all()
    live = SocEstimator(estimator, 0.9)
    streamed = [live.update(*sample).soc for sample in zip(TIME_S[:50], CURRENT_A, LOG.voltage_V, strict=False)]
    assert streamed == pytest.approx(run.soc[:50], abs=1e-12)


def test_a_declared_rest_reaches_the_filter_and_an_undeclared_one_does_not():
    undeclared = make_estimator("ekf", BATTERY)
    declared = make_estimator("ekf", replace(BATTERY, idle_current_A=0.0))
    assert isinstance(undeclared, TheveninFilter) and undeclared.idle_current_A is None
    assert isinstance(declared, TheveninFilter) and declared.idle_current_A == 0.0


def test_refusals():
    with pytest.raises(
        InputError, match=r"filter must be one of default, ekf, ukf, gsf, rc, .* published.rc-kf, got 'kf'"
    ):
        make_estimator("kf", BATTERY)
