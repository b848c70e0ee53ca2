import math

import numpy as np
import pytest

from battery.examples import LFP, NMC, STRAIGHT
from ohmward.battery.chemistries import generic_battery, start_model, start_noise
from ohmward.battery.models.noise import BatteryNoise, CurrentSensor, usual_sensor
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.initial_soc import COARSE_CELLS, VoltageStart, first_voltage_std
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.errors import InputError

REST = CircuitInput(0.0, 25.0)
NOISE = BatteryNoise()
SENSOR = CurrentSensor()


def hypotheses(voltage_V, u, model, noise, sensor, soc=None, soc_std=0.03, count=1):
    """Parts of the density of SoC, given a first sample of this voltage at this current and temperature."""
    first = SocSample(0.0, u.current_A, voltage_V, u.temperature_degC)
    return VoltageStart(model, noise, sensor, count=count).hypotheses(first, soc, soc_std)


def moments_of(parts):
    """Mean and standard deviation of a sum of parts."""
    weight = np.array([part.weight for part in parts])
    mean, std = np.array([(part.start.soc, part.start.std) for part in parts]).T
    whole = np.average(mean, weights=weight)
    return whole, math.sqrt(np.average(std**2 + (mean - whole) ** 2, weights=weight))


def initial_soc(*arguments, **given):
    """Moments of the whole density."""
    (whole,) = hypotheses(*arguments, **given)
    return whole.start


def test_nothing_known_is_uniform():
    start = initial_soc(math.nan, REST, NMC, NOISE, SENSOR)
    assert start.soc == pytest.approx(0.5, abs=1e-9)
    assert start.std == pytest.approx(1 / math.sqrt(12), rel=0.01)


def test_a_straight_curve_gives_the_textbook():
    """With a slope of 1 V the sigma of SoC is that of the voltage."""
    start = initial_soc(3.5, REST, STRAIGHT, NOISE, SENSOR)
    assert start.soc == pytest.approx(0.5, abs=1e-6)
    assert start.std == pytest.approx(
        first_voltage_std(np.array([0.5, 0.51]), REST, STRAIGHT, NOISE, SENSOR)[0], rel=0.01
    )


def test_value_and_voltage_are_weighed_by_their_variances():
    """The product of two Gaussians; the prior's doubt adds next to nothing where both agree."""
    voltage_std = float(first_voltage_std(np.array([0.5, 0.51]), REST, STRAIGHT, NOISE, SENSOR)[0])
    start = initial_soc(3.51, REST, STRAIGHT, NOISE, SENSOR, soc=0.5, soc_std=voltage_std)
    assert start.soc == pytest.approx(0.505, abs=2e-4)
    assert start.std == pytest.approx(voltage_std / math.sqrt(2), rel=0.02)


@pytest.mark.parametrize("soc", [0.0, 0.1234, 0.50123456, 0.9012, 1.0])
@pytest.mark.parametrize("soc_std", [1e-9, 1e-5, 1e-3])
def test_a_value_that_is_surely_known_is_kept_wherever_it_lies(soc, soc_std):
    start = initial_soc(math.nan, REST, NMC, NOISE, SENSOR, soc=soc, soc_std=soc_std)
    assert start.soc == pytest.approx(soc, abs=0.02 * 0.5 + 1e-6)
    agreed = initial_soc(3.0 + soc, REST, STRAIGHT, NOISE, SENSOR, soc=soc, soc_std=soc_std)
    assert agreed.soc == pytest.approx(soc, abs=1e-3)


def test_a_current_is_taken_out_of_the_voltage():
    assert initial_soc(3.5 - 2 * 0.02, CircuitInput(-2.0, 25.0), STRAIGHT, NOISE, SENSOR).soc == pytest.approx(
        0.5, abs=1e-4
    )


def test_a_value_that_the_voltage_contradicts_is_overruled():
    start = initial_soc(float(NMC.ocv.mean_V(0.8, 25.0)), REST, NMC, NOISE, SENSOR, soc=0.3)
    assert start.soc == pytest.approx(0.8, abs=0.02)


def test_on_a_plateau_the_value_stands():
    start = initial_soc(float(LFP.ocv.mean_V(0.5, 25.0)), REST, LFP, NOISE, SENSOR, soc=0.55)
    assert abs(start.soc - 0.5) < 2 * start.std
    assert abs(start.soc - 0.55) < 0.02


def test_on_a_plateau_the_voltage_alone_says_little():
    assert initial_soc(float(LFP.ocv.mean_V(0.5, 25.0)), REST, LFP, NOISE, SENSOR).std > 0.08


def test_beyond_the_curve_is_full_or_empty():
    assert initial_soc(4.5, REST, NMC, NOISE, SENSOR).soc > 0.97
    assert initial_soc(2.9, REST, NMC, NOISE, SENSOR).soc < 0.03


#: Volts of a cell on the charger, and of one that is empty.
ENDS = {"lfp": (3.6, 2.2), "nmc": (4.2, 2.7), "nca": (4.2, 2.7), "lead-acid": (2.25, 1.75)}


@pytest.mark.usefixtures("in_python")
@pytest.mark.parametrize("chemistry", ENDS)
def test_a_label_knows_full_and_empty_by_its_voltage(chemistry):
    """Little is known of a label's knee at empty, but a curve that ascends cannot reach full there."""
    battery, (full_V, empty_V) = generic_battery(chemistry, 2.0, 8), ENDS[chemistry]
    for name in ("ekf", "gsf"):
        full = SocEstimator(battery, filter=name).update(0.0, 0.0, 8 * full_V)
        empty = SocEstimator(battery, filter=name).update(0.0, 0.0, 8 * empty_V)
        assert full.soc > 0.9 and full.soc_std < 0.1
        assert empty.soc < 0.1 and empty.soc_std < 0.1


@pytest.mark.usefixtures("in_python")
@pytest.mark.parametrize("chemistry", ["lfp", "nmc", "nca", "lipo"])
def test_a_label_at_rest_where_its_curve_ends_is_full(chemistry):
    """Its charger stops no lower than the voltage that is seen, and the curve ends where such cells are full."""
    battery = generic_battery(chemistry, 2.0)
    full_V = float(battery.thevenin.ocv.voltage_V[-1])
    full = SocEstimator(battery).update(0.0, 0.0, full_V)
    assert full.soc > 0.97 and full.soc_std < 0.03
    below = SocEstimator(battery).update(0.0, 0.0, full_V - 0.1)
    assert below.soc + 2.0 * below.soc_std > 0.97 and below.soc_std > 0.05


@pytest.mark.parametrize("voltage_V", [0.0, -3.0, 9.0, 1e300, math.inf])
def test_an_absurd_voltage_is_none(voltage_V):
    assert initial_soc(voltage_V, REST, NMC, NOISE, SENSOR) == initial_soc(math.nan, REST, NMC, NOISE, SENSOR)


def test_the_claimed_sigma_holds():
    """Draw truth and voltage from what the noise says, and count."""
    rng = np.random.default_rng(1)
    truth = rng.uniform(0.1, 0.9, 400)
    std = first_voltage_std(np.linspace(0, 1, 401), REST, NMC, NOISE, SENSOR)
    error = np.interp(truth, np.linspace(0, 1, 401), std) * rng.standard_normal(400)
    starts = [
        initial_soc(float(NMC.ocv.mean_V(s, 25.0) + e), REST, NMC, NOISE, SENSOR)
        for s, e in zip(truth, error, strict=True)
    ]
    z = np.array([(start.soc - s) / start.std for start, s in zip(starts, truth, strict=True)])
    assert np.mean(np.abs(z) < 1.96) == pytest.approx(0.95, abs=0.03)
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("chemistry", ["lfp", "nmc", "lead-acid"])
def test_the_coarse_grid_of_a_microcontroller_finds_the_same_density(chemistry, count):
    battery = generic_battery(chemistry, 10.0)
    start = VoltageStart(battery.thevenin, battery.noise, battery.sensor, count=count)
    for soc in (0.05, 0.3, 0.6, 0.9, 1.0):
        first = SocSample(0.0, -2.0, float(battery.thevenin.ocv.mean_V(soc, 25.0)), 25.0)
        (mean, std), (coarse, coarse_std) = (
            moments_of(parts) for parts in (start.hypotheses(first), start.on_coarse_grid(first))
        )
        assert coarse == pytest.approx(mean, abs=0.5 / COARSE_CELLS)
        # only the last cell explains the voltage of a full LFP cell, and it is not resolved any further
        assert coarse_std == pytest.approx(std, rel=0.15, abs=0.01 if soc < 1.0 else 0.04)


def test_a_microcontroller_knows_nothing_without_a_voltage():
    start = VoltageStart(LFP, NOISE, SENSOR, count=3)
    parts = start.on_coarse_grid(SocSample(0.0, 0.0, math.nan, 25.0))
    assert np.isfinite([part.start for part in parts]).all()
    mean, std = moments_of(parts)
    assert (mean, std) == (pytest.approx(0.5), pytest.approx(1.0 / math.sqrt(12.0), rel=1e-3))


def test_refuses():
    with pytest.raises(InputError, match="initial_soc must be between 0 and 1, got 80"):
        initial_soc(3.7, REST, NMC, NOISE, SENSOR, soc=80.0)
    with pytest.raises(InputError, match="initial_soc_std must be > 0, got 0"):
        initial_soc(3.7, REST, NMC, NOISE, SENSOR, soc=0.8, soc_std=0.0)


@pytest.mark.parametrize("soc", [None, 0.2, 0.9])
@pytest.mark.parametrize("count", [2, 3, 5])
@pytest.mark.parametrize("voltage_V", [math.nan, 3.3, float(LFP.ocv.mean_V(0.9, 25.0))])
def test_the_parts_of_the_density_are_the_whole(soc, count, voltage_V):
    """Law of total variance: masses, means and standard deviations of the parts give those of the whole."""
    parts = hypotheses(voltage_V, REST, LFP, NOISE, SENSOR, soc, 0.03, count)
    (whole,) = hypotheses(voltage_V, REST, LFP, NOISE, SENSOR, soc, 0.03, 1)
    assert len(parts) == count
    weights = np.array([part.weight for part in parts])
    assert weights.sum() == pytest.approx(whole.weight, rel=1e-9)
    means, stds = np.array([part.start[:2] for part in parts]).T
    mean = weights @ means / weights.sum()
    variance = weights @ (stds**2 + (means - mean) ** 2) / weights.sum()
    assert mean == pytest.approx(whole.start.soc, abs=1e-3)
    assert math.sqrt(variance) == pytest.approx(whole.start.std, rel=0.02)


def test_cells_of_an_unknown_start_have_equal_mass():
    thirds = hypotheses(math.nan, REST, LFP, NOISE, SENSOR, None, 0.03, 3)
    assert [part.weight for part in thirds] == pytest.approx([thirds[0].weight] * 3)
    assert [part.start.soc for part in thirds] == pytest.approx([1 / 6, 1 / 2, 5 / 6], abs=0.003)
    assert [part.start.std for part in thirds] == pytest.approx([1 / math.sqrt(108)] * 3, rel=0.02)


def test_told_right_comes_first_and_loses_where_the_voltage_says_so():
    agreed = hypotheses(float(NMC.ocv.mean_V(0.3, 25.0)), REST, NMC, NOISE, SENSOR, 0.3, 0.03, 3)
    assert agreed[0].start.soc == pytest.approx(0.3, abs=0.01)
    assert agreed[0].weight > 20 * sum(part.weight for part in agreed[1:])
    denied = hypotheses(float(NMC.ocv.mean_V(0.9, 25.0)), REST, NMC, NOISE, SENSOR, 0.3, 0.001, 3)
    assert denied[0].weight < 1e-6 * denied[1].weight
    assert denied[0].start.soc == pytest.approx(0.3, abs=0.01)
    assert [part.start.soc for part in denied[1:]] == pytest.approx([0.9, 0.9], abs=0.03)


def test_the_error_of_the_model_goes_with_the_state_of_charge_of_an_unknown_start():
    """On a straight curve v = a + b s + e: given v, s is (v - a - e) / b, and e keeps its prior."""
    noise = BatteryNoise(model_std_V=(0.05, 0.05), voltage_std_V=1e-6, soc_axis_std=0.0)
    start = initial_soc(3.5, REST, STRAIGHT, noise, CurrentSensor(offset_std_A=0.0))
    assert start.soc == pytest.approx(0.5, abs=1e-6)
    assert start.std == pytest.approx(0.05, rel=1e-3)
    assert (start.model_error, start.model_error_std) == pytest.approx((0.0, 1.0), abs=1e-3)
    assert start.covariance == pytest.approx(-0.05, rel=1e-3)
    told = initial_soc(3.5, REST, STRAIGHT, noise, CurrentSensor(offset_std_A=0.0), soc=0.5)
    assert told[2:] == (0.0, 1.0, 0.0)


def test_the_same_voltage_once_more_is_no_news():
    """An hour of rest from an unknown start leaves the band as the first voltage has made it, but for hysteresis and a
    tangent in place of the curve; nine more hours leave it so.
    """
    model, noise = start_model("nmc", 2.0), start_noise("nmc")
    voltage_V = float(model.ocv.mean_V(0.5, 25.0))
    first = initial_soc(voltage_V, REST, model, noise, usual_sensor(2.0))
    estimator = SocEstimator(TheveninFilter(model, noise, usual_sensor(2.0), idle_current_A=0.0))
    hours = [estimator.update(float(time_s), 0.0, voltage_V) for time_s in range(36_001)][3600::32_400]
    for estimate in hours:
        assert estimate.soc == pytest.approx(first.soc, abs=0.02)
        assert 0.8 * first.std < estimate.soc_std < 1.1 * first.std
    assert hours[1].soc_std == pytest.approx(hours[0].soc_std, rel=0.02)
