"""The chain on measured batteries; bounds are about one and a half times what was found, nothing is tuned per file."""

import numpy as np
import pytest

from battery.identification.examples import identify, identify_in_detail, measured
from ohmward.battery.identification import IdentificationSettings
from ohmward.battery.identification.fit_samples import simulate, thin
from ohmward.battery.identification.record import make_records
from ohmward.battery.identification.soc_axis import anchor_soc

pytestmark = pytest.mark.slow
LEAF = "ornl_nissan_leaf_cell/cell-"
PANASONIC = "panasonic_18650pf/25degC_"
A123 = "plett_a123_lfp/a123_"


def voltage_error_V(p, log, capacity_Ah, ocv=None):
    """Simulated minus measured voltage along a log and the samples that it belongs to."""
    (record,) = make_records(log, capacity_Ah)
    (part,) = thin(record, anchor_soc(record, capacity_Ah, ocv).soc)
    return simulate(part, p) - part.voltage_V, part


def test_leaf_pulse_test_reproduces_the_1c_discharge():
    battery = identify(measured(LEAF + "low-current-hppc-25c-2.parquet"), capacity_Ah=30.34)
    error_V, part = voltage_error_V(battery.thevenin, measured(LEAF + "discharge-bitrode-1c.parquet"), 30.34)
    discharge = (part.mean_current_A < -20) & (part.soc > 0.1)
    assert np.sqrt(np.mean(error_V[discharge] ** 2)) < 0.018
    assert 1000 < battery.thevenin.tau_s[-1] < 3000  # the slowest pair


@pytest.mark.parametrize("log, rms_V, middle_ohm", [("10c", 0.02, 0.0031), ("40c-1", 0.055, 0.0017)])
def test_leaf_at_other_temperatures(log, rms_V, middle_ohm):
    """At 40 degC the cell holds 3 % more than was said, and is worst below the SoC that was called empty."""
    battery = identify(measured(f"{LEAF}low-current-hppc-{log}.parquet"), capacity_Ah=30.34)
    (fit,) = battery.identification.logs
    assert fit.residual_rms_V < rms_V
    assert np.mean(battery.thevenin.r0_discharge_ohm[6:19]) == pytest.approx(middle_ohm, rel=0.25)


@pytest.mark.parametrize(
    "degC, bias_mV, model", [(5, 40, "thevenin-2rc"), (25, 25, "thevenin"), (45, 30, "thevenin-2rc")]
)
def test_a123_from_one_half_reproduces_the_other(degC, bias_mV, model):
    sweeps = [measured(A123 + "ocv.parquet", where={"temp_C": degC, "script": script}) for script in (1, 3)]
    drive = measured(A123 + "dyn.parquet", where={"temp_C": degC, "script": 1})
    found = identify_in_detail(
        [*sweeps, drive.select(slice(0, len(drive) // 2))],
        IdentificationSettings(2.03, chemistry="lfp", model=model),
    )
    assert found.battery.identification.logs[0].residual_rms_V < 0.004
    error_V, part = voltage_error_V(found.battery.thevenin, drive, 2.03, found.first_ocv)
    unseen = (part.soc > 0.1) & (part.soc < 0.45)
    assert 1e3 * abs(np.mean(error_V[unseen])) < bias_mV
    claimed_V = np.interp(part.soc, np.linspace(0, 1, 21), found.battery.noise.model_std_V)
    assert np.mean(np.abs(error_V) < 1.96 * claimed_V + 0.01) > 0.85


def test_panasonic_pulse_test_reproduces_a_drive():
    logs = [measured(PANASONIC + "C20_OCV.parquet"), measured(PANASONIC + "HPPC.parquet")]
    found = identify_in_detail(logs, IdentificationSettings(2.9, chemistry="nca"))
    said = found.battery.identification.notes
    assert any("moved 2.995 Ah (+3.3% of the given capacity)" in note and note.startswith("warning") for note in said)
    assert any("in 13 gaps" in note for note in said)
    error_V, part = voltage_error_V(
        found.battery.thevenin, measured(PANASONIC + "Cycle_1.parquet"), 2.9, found.first_ocv
    )
    assert np.sqrt(np.mean(error_V[part.soc > 0.15] ** 2)) < 0.040


def test_lead_acid_telemetry():
    log = measured("bboxx_vrla_12v_17ah/telemetry_2017-03-25_2017-03-29.csv")
    first_days = log.between(0.0, 170000.0)
    battery = identify(first_days, capacity_Ah=19.5, chemistry="lead-acid", n_series=6, model="thevenin-1rc")
    assert battery.thevenin.coulombic_efficiency == pytest.approx(0.93, abs=0.03)
    assert battery.thevenin.tau_s[0] > 1000
    later = log.between(171000.0, 206000.0)
    error_V, part = voltage_error_V(battery.thevenin, later, 19.5)
    middle = (part.soc > 0.15) & (part.soc < 0.95) & (part.current_A < -1)
    assert np.sqrt(np.mean(error_V[middle] ** 2)) < 0.05


def test_a_low_rate_charge_alone():
    battery = identify(measured("calce_a123_lfp/a1_C20_charge_20C.parquet"), capacity_Ah=1.05)
    assert battery.identification.capacity_measured_Ah == pytest.approx(1.052, abs=2e-3)
    assert any("resistances and time constants" in sentence for sentence in battery.not_identified)
