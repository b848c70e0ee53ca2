"""The sign of a current that a log itself does not tell: from the battery file."""

from pathlib import Path

import numpy as np
import pytest

import ohmward as ow
from ohmward.battery.file import BATTERY_FILE
from ohmward.battery.log_check import read_log_of, sign_by_model
from ohmward.fleet.job import Job
from ohmward.logs.log import ReadOptions, UnknownSignError

BATTERY = ow.generic_battery("nmc", 10.0)
RAMP_S = np.arange(0.0, 7200.0, 10.0)


def ramp(sign=1.0, start_soc=0.8):
    """A current that rises for two hours without an edge, through a voltmeter of 10 mV: only the charge tells."""
    current_A = -1.0 - 3.0 * RAMP_S / RAMP_S[-1]
    soc = start_soc + np.cumsum(current_A) * 10.0 / 3600.0 / BATTERY.capacity_Ah
    curve = BATTERY.thevenin.ocv.voltage_V
    voltage_V = np.interp(soc, np.linspace(0.0, 1.0, len(curve)), curve) + 0.01 * current_A
    return ow.Log("ramp", RAMP_S, sign * current_A, np.round(voltage_V, 2))


def pulses(sign=1.0):
    current_A = np.where(RAMP_S % 600.0 < 300.0, 0.0, -5.0)
    return ow.Log("pulses", RAMP_S, sign * current_A, 3.8 + 0.02 * current_A)


def write(folder: Path, name: str, log: ow.Log) -> str:
    path = folder / name
    ow.write_log(log, path)
    return str(path)


@pytest.mark.parametrize(("sign", "expected"), [(1.0, "charge"), (-1.0, "discharge")])
def test_the_battery_tells_the_sign_by_the_charge(sign, expected):
    assert sign_by_model(ramp(sign), BATTERY) == expected


def test_a_rest_and_a_battery_that_does_not_fit_tell_nothing():
    assert sign_by_model(ow.Log("rest", RAMP_S, np.zeros(RAMP_S.size), np.full(RAMP_S.size, 3.7)), BATTERY) is None
    assert sign_by_model(ramp(), ow.generic_battery("lfp", 10.0)) is None


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_log_that_tells_nothing_has_the_sign_of_its_battery(tmp_path, sign):
    path = write(tmp_path, "ramp.csv", ramp(sign))
    with pytest.raises(UnknownSignError):
        read_log_of(None, path, ReadOptions())
    log = read_log_of(BATTERY, path, ReadOptions())
    np.testing.assert_array_equal(log.current_A, ramp().current_A)
    assert [str(note) for note in log.notes if "according to the battery file" in note.text]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_sign_of_a_log_does_not_depend_on_the_logs_beside_it(tmp_path, sign):
    """Logs with equal columns that show the other sign, as of a robot whose sensor is wired the other way."""
    others = [write(tmp_path, f"{k}.csv", pulses(-sign)) for k in range(3)]
    path = write(tmp_path, "ramp.csv", ramp(sign))
    job = Job(BATTERY_FILE.dump(BATTERY), "coulomb")
    (alone,) = job.run([path])
    assert alone["error"] is None
    assert job.run([*others, path])[-1] == alone
    unfit = Job(BATTERY_FILE.dump(ow.generic_battery("lfp", 10.0)), "coulomb")
    (refused,) = unfit.run([path])
    assert "--current-sign" in refused["error"]
    assert unfit.run([*others, path])[-1] == refused
