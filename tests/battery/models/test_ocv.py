import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from battery.examples import GRID, LFP, NMC
from ohmward.battery.models.ocv import OcvCurve
from ohmward.errors import InputError

CURVE = OcvCurve((3.0, 3.3, 3.5, 4.0), (0.01, 0.02, 0.02, 0.0), (1e-3, 0.0, 0.0, -1e-3), reference_degC=20.0)


def test_passes_through_its_points():
    assert CURVE.mean_V(np.linspace(0, 1, 4), 20.0) == pytest.approx(CURVE.voltage_V, abs=1e-15)
    assert CURVE.hysteresis_at(np.linspace(0, 1, 4)) == pytest.approx(CURVE.hysteresis_V, abs=1e-15)


def test_warmth_adds_its_share():
    assert CURVE.mean_V(0.0, 30.0) - CURVE.mean_V(0.0, 20.0) == pytest.approx(10 * 1e-3, abs=1e-12)
    assert CURVE.mean_V(1.0, 30.0) - CURVE.mean_V(1.0, 20.0) == pytest.approx(-10 * 1e-3, abs=1e-12)


def test_beyond_the_ends_it_is_straight():
    below, end, inside = (CURVE.mean_V(s, 20.0) for s in (-0.2, 0.0, 1e-7))
    assert (end - below) / 0.2 == pytest.approx((inside - end) / 1e-7, rel=1e-4)


def test_is_near_the_monotone_cubic_of_scipy():
    soc = np.linspace(0.0, 1.0, 1000)
    assert NMC.ocv.mean_V(soc, 25.0) == pytest.approx(PchipInterpolator(GRID, NMC.ocv.voltage_V)(soc), abs=2e-5)


@given(st.lists(st.floats(0.0, 1.0), min_size=2, max_size=12))
def test_never_falls_where_its_points_do_not(steps):
    curve = OcvCurve(tuple(3.0 + np.cumsum(steps)))
    assert np.diff(curve.mean_V(np.linspace(-0.1, 1.1, 500), 25.0)).min() > -1e-12


@pytest.mark.parametrize("branch", [-1.0, 0.0, 1.0])
@pytest.mark.parametrize("ocv", [NMC.ocv, LFP.ocv], ids=["nmc", "lfp"])
def test_the_inverse_inverts(ocv, branch):
    for soc in (0.02, 0.3, 0.5, 0.77, 0.97):
        voltage_V = ocv.mean_V(soc, 25.0) + branch * ocv.hysteresis_at(soc)
        found = ocv.soc_at(voltage_V, 25.0, branch)
        assert ocv.mean_V(found, 25.0) + branch * ocv.hysteresis_at(found) == pytest.approx(voltage_V, abs=2e-6)
        if branch < 1.0:  # near full this charge branch of LFP falls a little and passes its voltages twice
            assert found == pytest.approx(soc, abs=2e-4)


def test_the_inverse_ends_at_empty_and_full():
    assert NMC.ocv.soc_at(2.0) == 0.0
    assert NMC.ocv.soc_at(5.0) == 1.0


def test_a_pack_has_the_voltages_of_its_cells():
    pack = CURVE.scaled(4)
    soc = np.linspace(0.0, 1.0, 50)
    assert pack.mean_V(soc, 31.0) == pytest.approx(4 * CURVE.mean_V(soc, 31.0), rel=1e-12)
    assert pack.hysteresis_at(soc) == pytest.approx(4 * CURVE.hysteresis_at(soc), rel=1e-12)
    assert pack.reference_degC == 20.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((3.0,),), r"ocv.voltage_V needs at least 2 points.* got 1"),
        (((3.0, 3.5, 3.4),), r"must not fall with SoC, but it does above SoC 0\.500"),
        (((3.0, np.nan),), r"ocv.voltage_V must be finite, got nan"),
        (((3.0, 4.0), (0.1,)), r"ocv.hysteresis_V must have 2 values .* got 1"),
        (((3.0, 4.0), (0.1, -0.1)), r"ocv.hysteresis_V must be >= 0, got -0.1"),
        (((3.0, 4.0), (), (0.0, np.inf)), r"ocv.temperature_V_per_K must be finite, got inf"),
    ],
)
def test_refuses(arguments, message):
    with pytest.raises(InputError, match=message):
        OcvCurve(*arguments)


def test_a_corrected_curve_rises_and_keeps_hysteresis_and_temperature_where_they_were():
    grid = np.linspace(0.0, 1.0, 5)
    curve = OcvCurve((3.0, 3.2, 3.4, 3.6, 4.0), (0.02,) * 5, (1e-4, 1e-4, 0.0, 0.0, 0.0), 20.0)
    assert curve.corrected(np.array(curve.voltage_V)) == curve
    found = curve.corrected(np.array([3.0, 3.3, 3.2, 3.6, 4.0]), 0.5, 2e-4 * grid)
    assert found.voltage_V == pytest.approx((3.0, 3.25, 3.25, 3.6, 4.0))
    assert found.hysteresis_V == pytest.approx((0.01,) * 5)
    assert found.temperature_V_per_K == pytest.approx((1e-4, 1.5e-4, 1e-4, 1.5e-4, 2e-4))
    upper = curve.corrected(np.linspace(3.4, 4.0, 5), soc=0.5 + 0.5 * grid)
    assert upper.temperature_V_per_K == pytest.approx((0.0,) * 5, abs=1e-12)
