"""Logs that the words of a command name."""

from pathlib import Path

import pytest

from ohmward.cli.battery_inputs import log_files
from ohmward.errors import InputError


def test_a_folder_without_logs_does_not_stop_those_beside_it(tmp_path):
    """It stays among the names, so that reading it says what is wrong."""
    empty, log = tmp_path / "empty", tmp_path / "day.csv"
    empty.mkdir()
    log.write_text("time_s,current_A,voltage_V\n0,0,12\n", encoding="utf-8")
    assert log_files([str(empty), str(log)]) == [str(empty), str(log)]


def test_a_folder_without_logs_alone_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="holds no log"):
        log_files([str(tmp_path)])
