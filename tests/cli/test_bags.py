"""Bags as logs of the commands."""

import shutil
from pathlib import Path

import pytest

from logs.bags.examples import TYPE, payloads, write_mcap
from ohmward.cli.battery_inputs import log_files
from ohmward.cli.main import main

TWO = ("soc", "two.mcap", "--battery", "label.toml")


@pytest.fixture
def recordings(tmp_path, monkeypatch) -> Path:
    """A folder with two batteries in one file, the folder of `ros2 bag record`, and a battery file."""
    monkeypatch.chdir(tmp_path)
    messages = payloads(300)
    write_mcap(tmp_path / "two.mcap", {"/front": (TYPE, messages), "/rear": (TYPE, messages)})
    (tmp_path / "day").mkdir()
    for part in range(2):
        write_mcap(tmp_path / "day" / f"day_{part}.mcap", {"/battery": (TYPE, messages[150 * part :][:150])})
    (tmp_path / "day" / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    assert main(["generic", "--chemistry", "lfp", "--capacity-ah", "12", "--n-series", "4", "-o", "label.toml"]) == 0
    return tmp_path


def test_a_topic_is_chosen_with_an_option_or_behind_the_file(recordings, as_json, capsys):
    assert main([*TWO]) == 2
    assert "choose with --topic /front" in capsys.readouterr().err
    assert as_json(*TWO, "--topic", "/rear")["steps"] == 300
    assert as_json("soc", "two.mcap:topic=/rear", "--battery", "label.toml")["steps"] == 300


def test_a_folder_of_ros2_bag_record_is_a_log(recordings, as_json):
    assert as_json("soc", "day", "--battery", "label.toml")["steps"] == 300
    assert main(["doctor", "day"]) == 0


def test_in_a_folder_of_logs_a_recording_is_one(recordings):
    shutil.move("two.mcap", "day.mcap")
    assert log_files(["."]) == ["day", "day.mcap"]
    assert log_files(["day"]) == ["day"]
