"""The rehearsal of a blind benchmark: its cases as published, on models whose error is known beforehand."""

import io
import zipfile

import numpy as np
import pytest

from embedded.batteries import BATTERY
from ohmward.embedded import battery_export, blind
from ohmward.embedded.python_file import python_file
from ohmward.errors import InputError
from ohmward.logs import Log

CAPACITY_AH = 4.6


def run_of(current_A=-4.6, hours=0.9, name="drive"):
    """A run from full at this current, once in two seconds."""
    time_s = np.arange(0.0, 3600.0 * hours, 2.0)
    current = np.full(time_s.size, current_A)
    log = Log(name, time_s, current, 3.7 + 0.1 * np.cos(time_s), np.full(time_s.size, 25.0))
    start = 1.0 if current_A < 0 else 0.1
    return blind.blind_run(log, start + current_A * time_s / 3600.0 / CAPACITY_AH)


def counter(X, z=None, start=1.0):
    """Counts from full, and believes its padding."""
    moved = (0.0 if z is None else z) + np.cumsum(X[:, 0]) / 3600.0 / CAPACITY_AH
    return start + moved, moved[-1]


def test_a_run_has_a_row_every_second():
    run = run_of()
    assert run.rows.shape == (3239, 3) and not run.charges
    np.testing.assert_allclose(np.diff(run.soc), -1.0 / 3600.0)


def test_padding_is_an_hour_of_the_first_row_without_its_current_in_a_restart():
    seen = []

    def listening(X, z=None):
        seen.append(X.copy())
        return np.zeros(len(X)), None

    list(blind.rehearse(listening, run_of(), CAPACITY_AH))
    (paddings, runs) = seen[0::2], seen[1::2]
    assert [len(padding) for padding in paddings] == [3600] * 6
    currents = [padding[0, 0] for padding in paddings]
    assert currents == pytest.approx([-4.6, 0.0, 0.0, 0.0, -4.3, -4.9])
    assert all((padding == padding[0]).all() for padding in paddings)
    assert [padding[0, 1] for padding in paddings] == [rows[0, 1] for rows in runs]


def test_a_counter_is_wrong_by_its_padding_its_restart_and_its_offset():
    """The padding of a drive is an hour at 1 C; a restart finds it full; 0.3 A moves it by 6.5 % an hour."""
    scores = list(blind.rehearse(counter, run_of(), CAPACITY_AH))
    drive, *restarts, above, below = (score.rmse for score in scores)
    assert drive == pytest.approx(1.0, abs=2e-3)
    assert restarts == pytest.approx([0.1, 0.4, 0.7], abs=2e-3)
    hours = np.arange(1, 3240) / 3600.0
    share = 0.3 / 4.6
    assert above == pytest.approx(float(np.sqrt(np.mean((-1.0 + share * (1.0 + hours)) ** 2))), abs=2e-3)
    assert below > above
    assert blind.case_rmse(scores, "restarts") == pytest.approx((3 * 0.1 + 2 * 0.4 + 0.7) / 6, abs=2e-3)


def test_the_score_is_the_mean_by_weights_of_the_cases_that_were_run():
    scores = [blind.BlindScore("drives", "a", 1.0, 0.02), blind.BlindScore("offset", "a", 1.0, 0.04)]
    assert blind.weighted_rmse(scores) == pytest.approx((0.7 * 0.02 + 0.1 * 0.04) / 0.8)
    (charge,) = blind.rehearse(lambda X, z=None: (np.full(len(X), 0.1), None), run_of(2.3), CAPACITY_AH)
    assert charge.case == "charges"


def test_the_archive_holds_the_file_and_the_file_is_a_model():
    text = python_file(battery_export(BATTERY, "coulomb", blind.MODULE, sample_time_s=1.0), 1.0)
    with zipfile.ZipFile(io.BytesIO(blind.submission(text))) as archive:
        assert archive.namelist() == ["Model.py"] and archive.read("Model.py").decode() == text
    soc, z = blind.model_of(text)(np.tile([0.0, 13.25, 25.0], (5, 1)))
    assert soc.shape == (5,) and z is not None


def test_a_log_with_a_gap_or_without_a_truth_is_refused():
    log = Log("drive", np.array([0.0, 1.0, 100.0]), np.zeros(3), np.full(3, 3.7), None)
    with pytest.raises(InputError, match="drive: a gap of 99 s"):
        blind.blind_run(log, np.ones(3))
    with pytest.raises(InputError, match="drive: the column of the true state of charge has no value"):
        blind.blind_run(log, np.full(3, np.nan))
