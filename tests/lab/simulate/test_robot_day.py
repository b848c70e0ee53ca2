import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import examine, read_log
from ohmward_lab.simulate import RobotDay, make_robot_day, write_robot_day
from ohmward_lab.simulate.robot_day import CHEMISTRIES


@pytest.fixture(scope="module", params=CHEMISTRIES)
def day(request) -> RobotDay:
    return make_robot_day(request.param, seed=1)


def test_logs_say_that_they_are_simulated(day):
    for log in day:
        assert log.name.startswith("simulated ")
        assert "simulated, not measured" in log.notes[0].text


def test_the_truth_starts_full_and_stays_between_empty_and_full(day):
    for log in day:
        soc = log.extra["soc_true"]
        assert soc[0] == 1.0
        assert soc.min() >= 0.0
        assert soc.max() <= 1.0
    assert day.pulse_test.extra["soc_true"][-1] < 0.01
    assert 0.05 < day.mission.extra["soc_true"].min() < 0.5


def test_discharge_lowers_the_truth_as_the_current_says(day):
    log = day.pulse_test
    fall = np.diff(log.extra["soc_true"][[0, -1]])[0]
    assert log.charge_Ah()[-1] / 12.0 == pytest.approx(fall, abs=0.04)


def test_the_day_is_as_long_and_as_gappy_as_it_says(day):
    found = examine(day.mission).survey
    assert found.duration_s == pytest.approx(9.4 * 3600.0, rel=0.02)
    assert found.sampling.median_s == pytest.approx(1.0, abs=0.01)
    assert found.sampling.gaps >= 1
    assert found.current.missing > 0
    assert found.sign.verdict == "charge"


def test_the_current_sensor_reads_its_offset_while_docked(day):
    docked = day.mission.time_s > day.mission.time_s[-1] - 1800.0
    read = np.nanmedian(day.mission.current_A[docked])
    assert 0.03 - 0.025 <= abs(read) <= 0.06 + 0.025


def test_files_are_read_back_and_the_doctor_finds_no_error(day, tmp_path):
    files = write_robot_day(day, tmp_path)
    for log, path in zip(day, files, strict=True):
        back = read_log(path)
        np.testing.assert_array_equal(back.voltage_V, log.voltage_V)
        np.testing.assert_array_equal(back.current_A, log.current_A)
        np.testing.assert_array_equal(back.extra["soc_true"], log.extra["soc_true"])
        assert back.name == log.name.replace(" ", "-")
        assert examine(back).worst != "error"
    assert examine(read_log(files.pulse_test)).worst == "info"


def test_same_seed_same_day(day):
    same = make_robot_day("lead-acid" if "lead-acid" in day.mission.name else "lfp", seed=1)
    for one, again in zip(day, same, strict=True):
        np.testing.assert_array_equal(one.current_A, again.current_A)
        np.testing.assert_array_equal(one.voltage_V, again.voltage_V)
        assert one.notes == again.notes


def test_an_unknown_chemistry_is_refused():
    with pytest.raises(InputError, match="chemistry must be one of lfp, lead-acid, got 'nimh'"):
        make_robot_day("nimh")
