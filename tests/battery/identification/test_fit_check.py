"""Tests that no circuit of the named battery reproduces are named, and gassing is not taken for one."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward import make_robot_day
from ohmward.battery.identification import IdentificationSettings, Identified, identify_in_detail
from ohmward.logs.log import Log

SETTINGS = IdentificationSettings(capacity_Ah=12.0, chemistry="lfp", n_series=4)


def identified(log: Log, **settings) -> Identified:
    return identify_in_detail(log, SETTINGS._replace(**settings))


def notes_with(words: str, found: Identified) -> list[str]:
    assert found.battery.identification
    return [note for note in found.battery.identification.notes if words in note]


@pytest.fixture(scope="module")
def pulse_test() -> Log:
    return make_robot_day("lfp").pulse_test


def test_a_true_label_fits(pulse_test):
    found = identified(pulse_test)
    assert found.fits
    assert not notes_with("does not fit", found)


def test_a_current_of_the_wrong_sign_does_not_fit(pulse_test):
    found = identified(replace(pulse_test, current_A=-pulse_test.current_A))
    assert not found.fits
    (text,) = notes_with("does not fit", found)
    assert pulse_test.name in text


def test_gassing_is_left_out_and_said():
    """A charge that ends far above the curve, as lead-acid batteries are charged."""
    log = make_robot_day("lead-acid").pulse_test
    gassing = np.arange(20.0, 3620.0, 20.0)
    voltage_V = np.concatenate([log.voltage_V[0] + np.minimum(0.002 * gassing, 1.8), log.voltage_V])
    longer = replace(
        log,
        time_s=np.concatenate([gassing, gassing[-1] + 20.0 + log.time_s - log.time_s[0]]),
        current_A=np.concatenate([np.full(gassing.size, 0.05), log.current_A]),
        voltage_V=voltage_V,
        temperature_degC=None,
        extra={},
    )
    found = identified(longer, chemistry="lead-acid", n_series=6)
    (details,) = found.logs
    assert details.model.gassing_V
    assert details.gassing_share > 0.0
    residual_V = np.concatenate(details.residual_V)
    assert details.quality.residual_rms_V < 0.5 * np.sqrt(np.nanmean(residual_V**2))
    assert notes_with("gases", found)
