"""`identify --model rc` on a drive alone: the circuit and the straight line that it shows, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from battery.identification.examples import LFP_OCV, identify, identify_in_detail, measured
from ohmward.battery.chemistries import chemistry_prior
from ohmward.battery.identification import IdentificationSettings
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.errors import InputError
from ohmward_lab.published import rc, rc_circuit
from ohmward_lab.published.rc import rc_of_thevenin
from published.rc_examples import CAPACITY_AH, EVEN, log_of, simulate

SETTINGS = IdentificationSettings(CAPACITY_AH, "rc", name="drive")


@pytest.fixture(scope="module")
def drive():
    return log_of(simulate(EVEN, 5000, 2, voltage_std_V=0.002, current_std_A=0.02, soc=0.95).samples)


@pytest.fixture(scope="module")
def found(drive):
    return identify_in_detail(drive, SETTINGS._replace(initial_soc={drive.name: 0.95}))


def test_a_drive_without_rests_gives_the_circuit_and_the_line(found):
    np.testing.assert_allclose(rc_of_thevenin(found.battery.thevenin).circuit, EVEN, rtol=0.02)
    np.testing.assert_allclose(np.array(found.battery.thevenin.ocv.voltage_V)[[0, -1]], (11.75, 13.0), atol=0.02)


def test_a_line_is_in_doubt_beyond_its_log_by_30_percent_of_its_slope(found):
    along, lowest = np.array(found.battery.noise.model_std_V), found.battery.identification.logs[0].soc_min
    assert along[0] == pytest.approx(0.3 * 1.25 * lowest, rel=0.3)
    assert np.all(np.diff(along[:8]) < 0)


def test_a_drive_in_the_cold_is_a_reference_of_its_own(drive):
    """Resistances are those of the drive's temperature, where the straight line has its reference; warmer they fall."""
    cold = replace(drive, temperature_degC=np.full(len(drive.time_s), -5.0))
    battery = identify_in_detail(cold, SETTINGS._replace(initial_soc={drive.name: 0.95})).battery
    model = rc_of_thevenin(battery.thevenin)
    assert model.ocv.reference_degC == -5.0
    np.testing.assert_allclose(model.circuit, EVEN, rtol=0.02)
    assert rc.dc_resistance(rc_circuit.circuit_at(model, 25.0)) < 0.8 * rc.dc_resistance(EVEN)
    assert battery.noise.activation_std_K == chemistry_prior("").activation_std_K
    assert any("as usual for batteries" in sentence for sentence in battery.not_identified)


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
    with pytest.raises(InputError, match=r"its state of charge is unknown .* give it .--initial-soc"):
        identify_in_detail(drive.select(slice(0, 2500)), SETTINGS)


def test_a_drive_too_short_for_a_slope_and_a_charge_alone_are_refused(drive):
    short = drive.select(slice(0, 200))
    with pytest.raises(InputError, match=r"move SoC by .* % outside charges, do not show .* that rises"):
        identify(short, capacity_Ah=CAPACITY_AH, model="rc", initial_soc={drive.name: 0.95})
    charge = replace(drive, current_A=np.full(len(drive), 1.0))
    with pytest.raises(InputError, match=r"move SoC by 0 % outside charges, do not show .* that rises"):
        identify(charge, capacity_Ah=CAPACITY_AH, model="rc", initial_soc={drive.name: 0.0})


def test_a_curve_that_is_given_is_not_replaced_by_a_line(drive):
    """A curve of another battery: refused, not forgotten."""
    with pytest.raises(InputError, match="the given OCV curve runs from"):
        identify(drive, capacity_Ah=CAPACITY_AH, model="rc", initial_soc={drive.name: 0.95}, ocv=LFP_OCV)


@pytest.mark.slow
def test_measured_drives():
    """R_0 and R_1 of a DST on a straight line are those on a curve; the Panasonic's line serves another drive."""
    dst = measured("calce_inr18650_20r/DST_25C_80SOC.parquet")
    for chemistry in ("nmc", ""):
        battery = identify(dst, capacity_Ah=2.0, chemistry=chemistry, model="rc", initial_soc={dst.name: 0.8})
        _, r0, r1, _ = rc.four_numbers(rc_of_thevenin(battery.thevenin))
        assert r0 == pytest.approx(0.075, rel=0.05)
        assert r1 == pytest.approx(0.0194, rel=0.1)
    first, second = (measured(f"panasonic_18650pf/25degC_{name}.parquet") for name in ("Cycle_1", "HWFTa"))
    battery = identify(first, capacity_Ah=2.9, model="rc", initial_soc={first.name: 1.0})
    truth = 1 + second.extra["ah"] / 2.9
    for start in (1.0, 0.7, None):
        run = SocEstimator(battery, start, filter="rc").run(second)
        error = (run.soc - truth)[run.time_s > run.time_s[0] + 1800]
        assert np.sqrt(np.mean(error**2)) < 0.02
        assert np.mean(np.abs(error) < 1.96 * run.soc_std[run.time_s > run.time_s[0] + 1800]) > 0.95
