import numpy as np
import pytest

from battery.examples import NMC, drive, samples, scan, simulate
from ohmward.battery.models.noise import BatteryNoise, CurrentSensor
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.filters.belief import Belief
from ohmward_lab.published import rc_circuit
from ohmward_lab.published.hybrid import Hybrid, _surer
from ohmward_lab.published.rc import RcModel
from ohmward_lab.published.rc_filter import RcFilter

NOISE = BatteryNoise()
CAPACITANCE_F = rc_circuit.capacitance_for(NMC.capacity_Ah, NMC.ocv)
RC = RcModel(0.97 * CAPACITANCE_F, 0.03 * CAPACITANCE_F, 0.03, 0.03, 0.06, NMC.ocv, NMC.capacity_Ah)


def test_the_surer_of_two_is_taken_whole_and_moves_what_is_correlated():
    belief = Belief(np.array([0.5, 1.0]), np.array([[0.04, 0.01], [0.01, 0.02]]))
    moved, taken = _surer(belief, 0.6, 0.1)
    assert taken
    assert moved.mean == pytest.approx([0.6, 1.0 + 0.25 * 0.1])
    # the conditional of the second given the first stays what it was
    assert moved.cov[0, 0] == pytest.approx(0.01)
    assert moved.cov[1, 1] - moved.cov[0, 1] ** 2 / moved.cov[0, 0] == pytest.approx(0.02 - 0.01**2 / 0.04)


def test_the_less_sure_changes_nothing():
    belief = Belief(np.array([0.5, 1.0]), np.array([[0.04, 0.01], [0.01, 0.02]]))
    kept, taken = _surer(belief, 0.9, 0.3)
    assert not taken
    assert np.array_equal(kept.mean, belief.mean) and np.array_equal(kept.cov, belief.cov)


def test_without_a_rest_it_is_the_thevenin_filter():
    truth = simulate(NMC, np.full(600, -1.0), 0.8)
    columns = samples(truth, 0.0, NOISE)
    thevenin = TheveninFilter(NMC, NOISE)
    _, alone = scan(thevenin, columns, 0.8)
    unsure = BatteryNoise(model_std_V=(0.2, 0.2))
    _, both = scan(Hybrid(thevenin, RcFilter(RC, unsure)), columns, 0.8)
    assert both.soc == pytest.approx(alone.soc, abs=1e-12)
    assert both.soc_std == pytest.approx(alone.soc_std, abs=1e-12)


def test_a_rest_corrects_once_where_the_rc_filter_is_surer():
    current_A = np.concatenate([drive(np.random.default_rng(1), 1200, rest_every=10**6), np.zeros(2400)])
    columns = samples(simulate(NMC, current_A, 0.8), 0.0, NOISE)
    unsure, sensor = BatteryNoise(model_std_V=(0.3, 0.3), capacity_std=0.1), CurrentSensor(offset_std_A=0.5)
    hybrid = Hybrid(TheveninFilter(NMC, unsure, sensor), RcFilter(RC, NOISE))
    _, estimates = scan(hybrid, columns, 0.8)
    corrections = np.flatnonzero(estimates.flags.astype(int) & SocFlag.REST)
    assert len(corrections) == 1
    assert corrections[0] == pytest.approx(1200 + hybrid.settle_s, abs=2)
    assert estimates.soc_std[corrections[0]] < estimates.soc_std[corrections[0] - 1]


def test_it_finds_the_truth_from_a_wrong_start():
    truth = simulate(NMC, drive(np.random.default_rng(2), 5400, mean_A=-0.3), 0.85)
    _, estimates = scan(Hybrid(TheveninFilter(NMC, NOISE), RcFilter(RC, NOISE)), samples(truth, 0.03, NOISE), 0.4)
    assert abs(estimates.soc[-1] - truth.soc[-1]) < 0.02


def test_a_clock_that_is_set_is_no_rest():
    hybrid = Hybrid(TheveninFilter(NMC, NOISE), RcFilter(RC, NOISE))
    state = hybrid.init(SocSample(0.0, 0.0, 3.7, 25.0), 0.5)
    later, estimate = hybrid.step(state, SocSample(1.5e9, 0.0, 3.7, 25.0))
    assert int(estimate.flags) & SocFlag.BAD_TIME and not int(estimate.flags) & SocFlag.REST
    assert later.rest == (0.0, 0.0)
    rested, _ = hybrid.step(later, SocSample(hybrid.settle_s + 1, 0.0, 3.7, 25.0))
    assert rested.rest == (hybrid.settle_s + 1, 1.0)
