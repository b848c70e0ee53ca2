"""What the figures show is what was given: the series, the bands, the stretches that carry a flag."""

import numpy as np
import pytest

from ohmward.battery.chemistries import start_model
from ohmward.battery.soc.sample import SocEstimate, SocFlag
from ohmward.figures import battery as pictures
from ohmward.logs import Log
from ohmward.report import Page

T = 200
TIME_S = np.arange(float(T))
LOG = Log("x", TIME_S, np.sin(TIME_S), 12.0 + 0.0 * TIME_S, np.full(T, 25.0))
NAN = np.full(T, np.nan)


def estimates(**fields) -> SocEstimate:
    values = dict.fromkeys(SocEstimate._fields, NAN) | {"soc": np.full(T, 0.5), "soc_std": np.full(T, 0.1)}
    return SocEstimate(**(values | {"flags": np.zeros(T)} | fields))


def series(figure) -> dict:
    return {s.label: s for s in figure.series}


def test_soc_is_shown_in_percent_with_a_band_of_1_96_sigma():
    figure = pictures.soc_figure(LOG, estimates(), truth=np.full(T, 0.4))
    assert series(figure)["estimate"].y == pytest.approx(50.0)
    assert series(figure)["reference"].y == pytest.approx(40.0)
    assert figure.bands[0].low == pytest.approx(50.0 - 19.59964)
    assert figure.bands[0].high == pytest.approx(50.0 + 19.59964)


def test_the_band_ends_where_the_charge_ends():
    figure = pictures.soc_figure(LOG, estimates(soc=np.full(T, 0.95)))
    assert figure.bands[0].high.max() == 100.0


def test_the_error_is_estimate_minus_reference():
    figure = pictures.soc_error_figure(LOG, estimates(), np.full(T, 0.45))
    assert figure.series[0].y == pytest.approx(5.0)
    assert figure.bands[0].high == pytest.approx(19.59964)


def test_offset_capacity_and_resistance_have_bands_of_95_per_cent():
    known = {"current_offset_A": 0.1, "soh_capacity": 0.9, "resistance_ratio": 1.2}
    stds = {"current_offset_std_A": 0.02, "soh_capacity_std": 0.05, "resistance_ratio_std": 0.3}
    shown = estimates(**{name: np.full(T, value) for name, value in (known | stds).items()})
    (band,) = pictures.offset_figure(LOG, shown).bands
    assert (band.low[0], band.high[0]) == pytest.approx((100 - 39.19928, 100 + 39.19928))
    capacity, resistance = pictures.health_figure(LOG, shown).bands
    assert (capacity.low[0], capacity.high[0]) == pytest.approx((90 - 9.79982, 90 + 9.79982))
    assert np.log([resistance.low[0] / 120, resistance.high[0] / 120]) == pytest.approx([-0.489991, 0.489991], rel=1e-5)


def test_a_resistance_that_cannot_be_has_no_band():
    ratio = np.where(TIME_S < 100, -0.1, 1e-9)
    band = pictures.health_figure(LOG, estimates(resistance_ratio=ratio, resistance_ratio_std=np.ones(T))).bands[1]
    assert np.isnan(band.high[:100]).all() and np.isfinite(band.high[100:]).all()


def test_first_seconds_do_not_flatten_the_errors():
    std = np.where(TIME_S < 2, 0.5, 0.01)
    figure = pictures.soc_error_figure(LOG, estimates(soc_std=std), np.full(T, 0.5))
    assert figure.y_limits == pytest.approx((-2.548, 2.548), rel=1e-3)


def test_more_estimators_than_hues_can_still_be_told_apart():
    figure = pictures.soc_comparison_figure(LOG, {f"filter {k}": estimates() for k in range(8)})
    assert [s.style for s in figure.series] == ["line"] * 6 + ["dashed"] * 2


def test_an_estimator_without_a_voltage_shows_none():
    assert list(series(pictures.voltage_figure(LOG, estimates()))) == ["measured"]
    expected = series(pictures.voltage_figure(LOG, estimates(voltage_V=np.full(T, 12.1))))
    assert list(expected) == ["measured", "expected"]


def test_flags_become_stretches():
    flags = np.zeros(T)
    flags[10:21] = SocFlag.REST
    flags[15:18] += SocFlag.NO_VOLTAGE
    flags[100] = SocFlag.VOLTAGE_REJECTED + SocFlag.SOC_LIMITED
    spans = pictures.soc_flag_spans(LOG, flags)
    assert [(s.x_from, s.x_to, s.label, s.role) for s in spans] == [
        (10.0, 20.0, "rest", "background"),
        (15.0, 17.0, "no voltage", "alert"),
        (100.0, 100.0, "voltage rejected", "alert"),
    ]


def test_branches_of_the_open_circuit_voltage():
    ocv = start_model("lfp", 10.0).ocv
    figure = pictures.ocv_figure(ocv)
    mean, charge, discharge = (series(figure)[name].y for name in ("mean", "charge branch", "discharge branch"))
    assert mean == pytest.approx(0.5 * (charge + discharge))
    assert charge - mean == pytest.approx(0.010)


def test_resistances_in_milliohm():
    model = start_model("nmc", 10.0)
    figure = pictures.resistance_figure(model)
    assert list(series(figure)) == ["R0 discharge", "R0 charge", "R1, 20 s", "R2, 500 s"]
    assert series(figure)["R0 discharge"].y == pytest.approx(10.0)


def test_the_histogram_is_a_density_beside_its_normal_distribution():
    values = 3.0 + 2.0 * np.random.default_rng(1).standard_normal(20_000)
    figure = pictures.residuals_figure(np.append(values, np.nan))
    density, normal = figure.series
    assert np.sum(density.y[:-1] * np.diff(density.x)) == pytest.approx(1.0)
    assert density.y[:-1] == pytest.approx(normal.y, abs=0.02)


def test_a_constant_has_a_histogram_too():
    assert pictures.residuals_figure(np.ones(10)).series


def test_nothing_known_has_an_empty_histogram():
    figure = pictures.residuals_figure(np.full(5, np.nan))
    assert not figure.series and "Residuals" in Page("Report").plot(figure).html()


def test_intervals_are_drawn_at_the_later_sample():
    figure = pictures.interval_figure(LOG)
    assert figure.series[0].x[0] == 1.0
    assert figure.series[0].y == pytest.approx(1.0)


def test_a_log_without_temperature_has_an_empty_figure():
    log = Log("x", TIME_S, np.ones(T), np.ones(T))
    assert np.isnan(pictures.temperature_figure(log).series[0].y).all()
