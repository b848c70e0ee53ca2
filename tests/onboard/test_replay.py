"""Logs replayed as if they were live: the same each time, in step with each other, and apart from the robot's state."""

import asyncio
import gc
import json
import math
from dataclasses import replace
from itertools import pairwise

import pytest

from ohmward import generic_battery, save_battery
from ohmward.errors import OhmwardError
from ohmward.onboard.assembly import STATE, assemble
from ohmward.onboard.message import Message
from ohmward.onboard.part import EndedError
from ohmward.onboard.robot_setup import Setup
from ohmward.onboard.sinks.json_lines import JsonLinesSink
from ohmward.onboard.sources.json_lines import JsonLinesSource
from ohmward.onboard.sources.replay import ReplaySource, replays_in_step
from ohmward.onboard.state_folder import NAME, write_snapshot


def battery_log(path, begin_s=0.0, seconds=20):
    rows = [f"{begin_s + k},{-2.0 - math.sin(k):.4f},{13.1 - 1e-3 * k:.4f}" for k in range(seconds)]
    path.write_text("\n".join(["time_s,current_A,voltage_V", *rows]) + "\n")
    return str(path)


def drive_log(path, begin_s=0.0, seconds=20):
    """Ten rows a second of a robot whose log has no yaw rate but in one row, and of no motor."""
    rows = [f"{begin_s + 0.1 * k:.1f},4.0,4.1,4.0,4.1,{0.01 if k == 50 else ''}" for k in range(10 * seconds)]
    names = ["time_s", *(f"wheel_speed_{k}_rad_s" for k in range(4)), "yaw_rate_rad_s"]
    path.write_text("\n".join([",".join(names), *rows]) + "\n")
    return str(path)


@pytest.fixture
def setup(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_battery(generic_battery("lfp", 10.0, 4), tmp_path / "battery.toml")
    source = ReplaySource(battery_log(tmp_path / "log.csv"), current_sign="charge", rate=math.inf)
    return Setup(battery="battery.toml", source=(source,))


def states(setup, tmp_path):
    """States of a run."""
    path = tmp_path / "states.jsonl"
    path.unlink(missing_ok=True)
    asyncio.run(assemble(replace(setup, sink=(JsonLinesSink(path=str(path)),))).run())
    gc.collect()  # gives the folder of the state back
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_a_replay_begins_anew_and_leaves_the_state_of_the_robot_alone(setup, tmp_path):
    (tmp_path / STATE).mkdir()
    (tmp_path / STATE / NAME).write_text("of the robot")
    first, second = states(setup, tmp_path), states(setup, tmp_path)
    assert len(first) == len(second) == 20
    for k in (0, -1):
        # to rounding: a second replay in one process may run as machine code where the first still ran as Python
        was, now = first[k]["battery"], second[k]["battery"]
        assert now.pop("flags") == was.pop("flags")
        assert now == pytest.approx(was, rel=1e-9)
    assert [path.name for path in (tmp_path / STATE).iterdir()] == [NAME]
    assert (tmp_path / STATE / NAME).read_text() == "of the robot"


def test_a_replay_has_the_dates_and_the_cells_of_its_log(setup, tmp_path):
    rows = [f"2024-05-01T10:00:{k:02d}Z,-2.{k},13.2,3.3,3.31,3.29,3.3" for k in range(20)]
    path = tmp_path / "dated.csv"
    path.write_text("\n".join(["time,current_A,voltage_V,cell_1_V,cell_2_V,cell_3_V,cell_4_V", *rows]) + "\n")
    found = states(replace(setup, source=(replace(setup.source[0], path=str(path)),)), tmp_path)
    assert [state["battery_unix_s"] for state in found[-2:]] == [1714557618.0, 1714557619.0]
    assert found[-1]["unix_s"] == pytest.approx(1714557619.0)
    assert len(found[-1]["cells"]["cells"]["soc"]) == 4


def test_a_replay_with_a_state_of_its_own_goes_on(setup, tmp_path):
    named = replace(setup, state="replayed")
    first, second = states(named, tmp_path), states(named, tmp_path)
    assert second[0]["battery"]["soc_std"] == pytest.approx(first[-1]["battery"]["soc_std"], rel=0.1)
    assert first[0]["battery"]["soc"] != second[0]["battery"]["soc"]


def test_a_replay_is_kept_out_of_the_state_of_a_robot_and_a_robot_begins_without_that_of_a_replay(setup, tmp_path):
    states(replace(setup, state="replayed"), tmp_path)
    robot = replace(setup, state="replayed", source=(JsonLinesSource(address="127.0.0.1:4710"),))
    process = assemble(robot)
    assert process.estimation.soc is not None and process.estimation.soc.state is None
    written = json.loads((tmp_path / "replayed" / NAME).read_text())
    assert written["live"] is False


def test_the_state_of_a_robot_is_refused_to_a_replay(setup, tmp_path):
    (tmp_path / "robot").mkdir()
    write_snapshot(tmp_path / "robot", {"boot": "b", "unix_s": 1.8e9, "monotonic_s": 1.0})
    with pytest.raises(OhmwardError, match=r"state = 'robot' is that of a robot, which a replay .* leave state out"):
        assemble(replace(setup, state="robot"))


def replayed(sources):
    """Source, time and signals of the messages of replays, in the order in which they came."""
    messages: list[Message] = []

    async def run():
        done = await asyncio.gather(*(s.run(messages.append) for s in replays_in_step(sources)), return_exceptions=True)
        return [type(error) for error in done]

    return asyncio.run(run()), messages


@pytest.mark.parametrize("battery_begins_s", [0.0, 5.0, 1e6])
def test_replays_of_a_process_are_in_step(tmp_path, battery_begins_s):
    """Without dates each log begins at once."""
    battery = ReplaySource(battery_log(tmp_path / "b.csv", battery_begins_s), None, "charge", math.inf, name="b")
    drive = ReplaySource(drive_log(tmp_path / "d.csv"), robot="rlma", rate=math.inf, name="d")
    ends, messages = replayed([battery, drive])
    assert ends == [EndedError] * 2
    assert len(messages) == 220
    assert all(after.received_s - before.received_s > -1e-6 for before, after in pairwise(messages))


def test_logs_with_dates_stay_beside_each_other(tmp_path):
    battery = ReplaySource(battery_log(tmp_path / "b.csv", 1.7e9 + 5.0), None, "charge", math.inf, name="b")
    drive = ReplaySource(drive_log(tmp_path / "d.csv", 1.7e9), robot="rlma", rate=math.inf, name="d")
    _, messages = replayed([battery, drive])
    began_s = messages[0].received_s
    assert next(m.received_s for m in messages if m.source == "b") - began_s == pytest.approx(5.0, abs=1e-3)


def test_a_log_that_cannot_be_read_holds_no_other(tmp_path):
    good = ReplaySource(battery_log(tmp_path / "b.csv"), None, "charge", math.inf, name="b")
    ends, messages = replayed([good, ReplaySource(str(tmp_path / "none.csv"), name="none")])
    assert EndedError in ends and len(messages) == 20


def test_what_a_log_does_not_have_is_no_signal(tmp_path):
    drive = ReplaySource(drive_log(tmp_path / "d.csv"), robot="rlma", rate=math.inf)
    _, messages = replayed([drive])
    wheels = {f"wheel_speed_rad_s.{k}" for k in range(4)}
    assert {frozenset(message.values) for message in messages} == {
        frozenset(wheels),
        frozenset(wheels | {"yaw_rate_rad_s"}),
    }
