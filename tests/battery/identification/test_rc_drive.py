"""`identify --model rc` on a drive alone: the straight line that it shows, the rule beside the fit, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from battery.identification.examples import LFP_OCV, identify, identify_in_detail, measured
from battery.rc_examples import CAPACITY_AH, EVEN, log_of, simulate
from ohmward.battery.chemistries import CHEMISTRIES
from ohmward.battery.identification import IdentificationSettings
from ohmward.battery.models import rc
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.errors import InputError

SETTINGS = IdentificationSettings(CAPACITY_AH, "rc", name="drive")


@pytest.fixture(scope="module")
def drive():
    return log_of(simulate(EVEN, 5000, 2, voltage_std_V=0.002, current_std_A=0.02, soc=0.95).samples)


@pytest.fixture(scope="module")
def found(drive):
    return identify_in_detail(drive, SETTINGS._replace(initial_soc={drive.name: 0.95}))


def test_a_drive_without_rests_gives_the_circuit_and_the_line(found):
    np.testing.assert_allclose(found.battery.rc.circuit, EVEN, rtol=0.02)
    np.testing.assert_allclose(found.battery.rc.ocv.voltage_V, (11.75, 13.0), atol=0.02)
    assert found.battery.thevenin is None


def test_the_rule_stands_beside_the_fit(found):
    assert found.rc.model == found.battery.rc
    assert rc.instant_resistance(found.rc.rule) == pytest.approx(rc.instant_resistance(EVEN), rel=0.02)
    assert found.rc.fit.rms_V < found.rc.rule_rms_V


def test_a_drive_in_the_cold_is_a_reference_of_its_own(drive):
    """Resistances are those of the drive's temperature, where the straight line has its reference; warmer they fall."""
    cold = replace(drive, temperature_degC=np.full(len(drive.time_s), -5.0))
    settings = SETTINGS._replace(initial_soc={drive.name: 0.95}, chemistry="lead-acid")
    battery = identify_in_detail(cold, settings).battery
    assert battery.rc.ocv.reference_degC == -5.0
    np.testing.assert_allclose(battery.rc.circuit, EVEN, rtol=0.02)
    assert rc.dc_resistance(battery.rc.circuit_at(25.0)) < 0.8 * rc.dc_resistance(EVEN)
    assert battery.rc_noise.activation_std_K == CHEMISTRIES["lead-acid"].prior.activation_std_K
    assert any("as usual for lead-acid" in sentence for sentence in battery.not_identified)


def test_the_line_is_said(found):
    assert found.battery.not_identified[0].startswith("open-circuit voltage: no curve in the logs; a straight line")
    assert any("the straight line through 'simulated'" in note for note in found.battery.identification.notes)
    assert found.battery.identification.logs[0].residual_rms_V == pytest.approx(0.002, rel=0.2)


def test_the_battery_finds_the_state_of_charge_of_another_drive(found):
    other = simulate(EVEN, 4000, 5, voltage_std_V=0.002, current_std_A=0.02, soc=0.9)
    for start in (0.9, 0.5, None):
        run = SocEstimator(found.battery, start, filter="rc").run(log_of(other.samples))
        error = (run.soc - other.soc)[1000:]
        assert np.sqrt(np.mean(error**2)) < 0.02
        assert np.mean(np.abs(error) < 1.96 * run.soc_std[1000:]) > 0.9


def test_a_drive_whose_state_of_charge_nobody_knows_is_refused(drive):
    with pytest.raises(InputError, match=r"nothing tells its state of charge .* give it .--initial-soc"):
        identify_in_detail(drive.select(slice(0, 2500)), SETTINGS)


def test_a_curve_that_is_given_is_not_replaced_by_a_line(drive):
    """A curve of another battery: refused, not forgotten."""
    with pytest.raises(InputError, match="the given OCV curve runs from"):
        identify(drive, capacity_Ah=CAPACITY_AH, model="rc", initial_soc={drive.name: 0.95}, ocv=LFP_OCV)


@pytest.mark.slow
def test_measured_drives():
    """R_0 and R_1 of a DST without a curve are those with the curve; the Panasonic's line serves another drive."""
    dst = measured("calce_inr18650_20r/DST_25C_80SOC.parquet")
    battery = identify(dst, capacity_Ah=2.0, chemistry="nmc", model="rc", initial_soc={dst.name: 0.8})
    assert rc.instant_resistance(battery.rc) == pytest.approx(0.075, rel=0.05)
    assert rc.slow_resistance(battery.rc) == pytest.approx(0.023, rel=0.1)
    first, second = (measured(f"panasonic_18650pf/25degC_{name}.parquet") for name in ("Cycle_1", "HWFTa"))
    battery = identify(first, capacity_Ah=2.9, chemistry="nca", model="rc", initial_soc={first.name: 1.0})
    truth = 1 + second.extra["ah"] / 2.9
    for start in (1.0, 0.7, None):
        run = SocEstimator(battery, start, filter="rc").run(second)
        error = (run.soc - truth)[run.time_s > run.time_s[0] + 1800]
        assert np.sqrt(np.mean(error**2)) < 0.02
        assert np.mean(np.abs(error) < 1.96 * run.soc_std[run.time_s > run.time_s[0] + 1800]) > 0.95
