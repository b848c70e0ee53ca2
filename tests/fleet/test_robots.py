"""Robots of a fleet: whose log a file is, their logs in order of time through one estimator, and the alarms of each."""

import re
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

import ohmward as ow
from fleet.examples import BATTERY, DAY_S, MODEL, START_S, day, write
from ohmward.battery.battery import Battery
from ohmward.battery.file import BATTERY_FILE, load_battery
from ohmward.errors import InputError
from ohmward.fleet import Job, ReadOptions, RobotJob, robot_states, robots_of, run_fleet
from ohmward.logs import write_table


def job(logs: dict[str, list[str]], battery: Battery = BATTERY, **options) -> RobotJob:
    settings = Job(BATTERY_FILE.dump(battery), "ekf", reading=ReadOptions(current_sign="charge"))
    return RobotJob(settings, logs, **options)


NAMES = ("amr-1_2026-01-05.csv", "amr-1_2026-01-06.csv", "amr-2_2026-01-05.csv")


@pytest.mark.parametrize(
    ("names", "robots"),
    [
        (NAMES, {"amr-1": 2, "amr-2": 1}),
        (("mower 3 run 12.csv", "mower 3 run 13.csv", "mower 4 run 1.csv"), {"mower 3": 2, "mower 4": 1}),
        (("rover_20260105T080000.csv", "rover_20260106T080000.csv"), {"rover": 2}),
        (("amr-1_1.csv", "amr-1_1 (1).csv", "Copy of amr-1_2.csv", "amr-1_3 - Copy (2).csv"), {"amr-1": 4}),
        (("2026-01-05_amr-1.csv", "2026-01-06_amr-1.csv", "2026-01-05T08-00-00_amr-2.csv"), {"amr-1": 2, "amr-2": 1}),
        (("r2_1767600000.csv", "r2_1767700000.csv", "r1_1767600000.csv"), {"r1": 1, "r2": 2}),
    ],
)
def test_the_name_before_a_date_or_a_number_is_the_robot(tmp_path, names, robots):
    texts = [write(tmp_path / name, day(k, 0.9)) for k, name in enumerate(names)]
    found = robots_of(texts)
    assert found.by == "name"
    assert {robot: len(logs) for robot, logs in found.logs.items()} == robots


def test_a_column_of_robots_wins_and_serves_files_that_cannot_be_read(tmp_path):
    texts = [write(tmp_path / name, day(k, 0.9), robot_id=f"R{k % 2}") for k, name in enumerate(NAMES)]
    (tmp_path / "R1_2026-02-01.csv").write_text("nothing\n")
    texts.append(str(tmp_path / "R1_2026-02-01.csv"))
    found = robots_of(texts)
    assert found.by == "robot_id"
    assert {robot: len(logs) for robot, logs in found.logs.items()} == {"R0": 2, "R1": 2}


def logs_with_ids(folder: Path) -> list[str]:
    """Two logs each of R0 and R1, with their robots in a column."""
    folder.mkdir()
    return [write(folder / f"{'abcd'[k]}.csv", day(k, 0.9), robot_id=f"R{k % 2}") for k in range(4)]


def test_a_log_without_the_column_of_the_robot_does_not_change_those_of_the_others(tmp_path):
    texts = logs_with_ids(tmp_path / "logs")
    other = write(tmp_path / "noid.csv", day(0, 0.9))
    found = robots_of([*texts, other])
    assert (found.by, found.otherwise) == ("robot_id", {"log": [other]})
    assert found.logs == {"R0": texts[::2], "R1": texts[1::2], "noid": [other]}


def test_a_column_that_is_named_ends_the_search_however_it_is_written(tmp_path):
    """Names alike say nothing where the column was asked for: neither of logs nor of files that cannot be read."""
    texts = [
        write(tmp_path / f"log_{k}.csv", day(k, 0.9), **{("robot_id", "Robot ID")[k // 2]: "R0"}) for k in range(4)
    ]
    others = [write(tmp_path / f"log_{k}.csv", day(k, 0.9)) for k in (4, 5)]
    (tmp_path / "log_6.csv").write_text("")
    found = robots_of([*texts, *others, str(tmp_path / "log_6.csv")], "robot_id")
    assert found.logs == {"R0": texts, "log_4": others[:1], "log_5": others[1:]}
    assert (found.otherwise, found.unreadable) == ({"log": others}, (str(tmp_path / "log_6.csv"),))


def test_files_that_are_no_logs_do_not_change_the_robots_and_are_none(tmp_path):
    texts = logs_with_ids(tmp_path / "logs")
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "header_only.csv").write_text("timestamp,current_A,voltage_V\n")
    (tmp_path / "photo.csv").write_bytes(bytes(range(256)) * 20)
    broken = [str(tmp_path / f"{name}.csv") for name in ("empty", "header_only", "photo")]
    found = robots_of([*broken, *texts])
    assert found == (*robots_of(texts)[:3], tuple(broken))
    assert robots_of([*broken, *texts[:1]]).by == "log"


def test_logs_of_different_robots_are_never_one_robot_by_their_names(tmp_path):
    texts = [write(tmp_path / f"run_{k}.csv", day(k, 0.9), robot_id=f"R{k}") for k in range(3)]
    assert robots_of(texts) == ("log", {text: [text] for text in texts}, {}, ())


@pytest.mark.parametrize(
    "names",
    [("x", "run 2", "y"), ("2026-01-05", "2026-01-06"), ("run_1", "run_2"), ("rosbag2_2026_01_05-08_00_00", "log_7")],
)
def test_names_of_no_robot_do_not_hide_the_folders(tmp_path, names):
    for robot in ("left", "right"):
        (tmp_path / robot).mkdir()
    places = [f"{robot}/{name}.csv" for robot in ("left", "right") for name in names]
    texts = [write(tmp_path / place, day(k, 0.9)) for k, place in enumerate(places)]
    found = robots_of(texts)
    half = len(names)
    assert (found.by, found.logs) == ("folder", {"left": texts[:half], "right": texts[half:]})


def test_logs_with_one_name_in_two_folders_stay_alone(tmp_path):
    texts = logs_with_ids(tmp_path / "logs")
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
    others = [write(tmp_path / folder / "noid.csv", day(k, 0.9)) for k, folder in enumerate(("one", "two"))]
    found = robots_of([*texts, *others])
    assert [len(logs) for logs in found.logs.values()] == [2, 2, 1, 1]


def test_a_file_of_several_robots_is_split_by_its_column(tmp_path):
    one, two = day(0, 0.9), day(0, 0.8)
    both = {name: np.concatenate([one[name], two[name]]) for name in one}
    labels = np.repeat(["a", "b"], len(one["current_A"])).astype(object)
    write_table(both | {"machine": labels}, tmp_path / "all.csv")
    found = robots_of([str(tmp_path / "all.csv")], "machine")
    assert found.logs == {key: [f"{tmp_path / 'all.csv'}:machine={key}"] for key in ("a", "b")}
    assert job(found.logs).run(["a x"])[0]["error"] is None


def test_folders_and_logs_alone(tmp_path):
    for robot in ("left", "right"):
        (tmp_path / robot).mkdir()
    places = ("left/x.csv", "left/y.csv", "right/x.csv", "right/y.csv")
    texts = [write(tmp_path / place, day(k, 0.9)) for k, place in enumerate(places)]
    assert {robot: len(logs) for robot, logs in robots_of(texts).logs.items()} == {"left": 2, "right": 2}
    assert robots_of(texts, "log").logs == {text: [text] for text in texts}
    assert robots_of(texts[:1]).by == "log"
    with pytest.raises(InputError, match="no log has the column 'robot'; name another column, or one of auto"):
        robots_of(texts, "robot")


def test_the_second_log_begins_with_what_the_first_has_found(tmp_path):
    """As one log of both days with the pause between them."""
    texts = [write(tmp_path / f"r_{k}.csv", day(k, 0.9 - 0.42 * k)) for k in range(2)]
    (row,) = job({"r": texts}).run(["r x"])
    logs = [ow.read_log(text, current_sign="charge") for text in texts]
    whole = ow.Log(
        "both",
        np.concatenate([logs[0].time_s, logs[1].time_s + DAY_S]),
        np.concatenate([log.current_A for log in logs]),
        np.concatenate([log.voltage_V for log in logs]),
    )
    run = ow.SocEstimator(BATTERY, filter="ekf").run(whole)
    assert [log["begins"] for log in row["logs"]] == ["2026-01-05T08:00:00+00:00", "2026-01-06T08:00:00+00:00"]
    assert row["logs"][1]["soc_final"] == pytest.approx(run.soc[-1], abs=1e-9)
    aged_std = float(np.hypot(run.estimates.soh_capacity_std[-1], 0.1 / 365))  # by the day between them
    assert row["logs"][1]["soh_capacity_std"] == pytest.approx(aged_std, abs=1e-9)


def test_logs_are_taken_in_order_of_time_and_those_recorded_twice_are_refused(tmp_path):
    texts = [write(tmp_path / f"{name}.csv", day(k, 0.9 - 0.42 * k)) for name, k in (("z", 0), ("a", 1), ("m", 1))]
    (row,) = job({"r": texts}).run(["r x"])
    assert [Path(log["path"]).stem for log in row["logs"]] == ["z", "a", "m"]
    assert "overlaps in time with a of this robot" in row["logs"][2]["error"]


def test_a_copy_under_another_name_is_of_the_same_robot(tmp_path):
    texts = [write(tmp_path / f"amr-{k}_2026-01-0{k}.csv", day(k, 0.9)) for k in (1, 2)]
    texts += [write(tmp_path / "amr-1_2026-01-09.csv", day(9, 0.9)), str(tmp_path / "copy of it.csv")]
    Path(texts[3]).write_bytes(Path(texts[0]).read_bytes())
    assert robots_of(texts).logs == {"amr-1": [texts[0], texts[2], texts[3]], "amr-2": texts[1:2]}


def test_a_log_without_a_clock_among_others_is_refused_and_alone_they_follow_each_other(tmp_path):
    bare = {name: values for name, values in day(1, 0.5).items() if name != "unix_time_s"}
    bare["time_s"] = day(1, 0.5)["unix_time_s"] - START_S - DAY_S
    without = [write(tmp_path / f"{k}.csv", bare) for k in range(2)]
    dated = write(tmp_path / "dated.csv", day(0, 0.9))
    (row,) = job({"r": [dated, *without]}).run(["r x"])
    assert [log["error"] is None for log in row["logs"]] == [True, False, False]
    (row,) = job({"r": without}).run(["r x"])
    assert [log["error"] for log in row["logs"]] == [None, None]


def test_a_date_that_is_left_out_is_named_where_it_is_missed(tmp_path):
    dated = write(tmp_path / "a.csv", day(0, 0.9))
    unsure = {name: values for name, values in day(1, 0.5).items() if name != "unix_time_s"}
    moments = day(1, 0.5)["unix_time_s"].astype("M8[s]").astype(datetime)
    dates = np.array([f"{moment:%d/%m/%Y %H:%M:%S}" for moment in moments], dtype=object)
    (row,) = job({"r": [dated, write(tmp_path / "b.csv", {"date": dates} | unsure)]}).run(["r x"])
    assert re.search("no wall clock.* may name the day or the month first.*--time-format", row["logs"][1]["error"])


def test_the_battery_of_each_robot_is_learnt(tmp_path):
    texts = [write(tmp_path / f"r_{k}.csv", day(k, 0.9 - 0.02 * k, resistance=1.5)) for k in range(3)]
    (row,) = job({"r": texts}, batteries=str(tmp_path)).run(["r x"])
    learnt = load_battery(row["battery"])
    assert learnt.name == "r" and learnt.thevenin is not None and MODEL is not None
    assert np.median(learnt.thevenin.r0_discharge_ohm) > 1.1 * np.median(MODEL.r0_discharge_ohm)


def test_a_capacity_that_settles_over_the_logs_is_no_change(tmp_path):
    """Deep discharges of a battery that has lost a fourth of a capacity that nobody knew, and does not change."""
    unknown = replace(BATTERY, noise=replace(BATTERY.noise, capacity_std=0.2))
    texts = [write(tmp_path / f"r_{k}.csv", day(7 * k, 1.0, hours=3.45, capacity=0.75)) for k in range(5)]
    (state,) = robot_states(job({"r": texts}, unknown).run(["r x"]))
    assert state.soh_change is not None and state.soh_change_std is not None
    assert abs(state.soh_change) < 2.0 * state.soh_change_std < 0.04


def test_a_capacity_that_no_log_shows_is_not_known(tmp_path):
    """A tenth of the charge in two days."""
    texts = [write(tmp_path / f"r_{k}.csv", day(k, 0.65, hours=0.5)) for k in range(2)]
    rows = job({"r": texts}).run(["r x"])
    (state,) = robot_states(rows)
    assert (state.soh_capacity, state.soh_change) == (None, None)
    assert [log["soh_capacity"] for log in rows[0]["logs"]] == [None, None]
    assert [row["soh_capacity"] for row in job({}).settings.run(texts)] == [None, None]


def test_alarms_name_the_robot_and_the_worst_is_first(tmp_path):
    fleet = {f"r{k}": [write(tmp_path / f"r{k}_{n}.csv", day(n, 0.9, 3.5 if k == 3 else 1.0)) for n in range(2)]
             for k in range(6)}  # fmt: skip
    (tmp_path / "r2_9.csv").write_text("nothing\n")
    fleet["r2"].append(str(tmp_path / "r2_9.csv"))
    states = robot_states(job(fleet).run([f"{robot} x" for robot in fleet]))
    assert states[0].robot == "r3" and states[0].resistance_ratio is not None and states[0].resistance_ratio > 2.0
    assert any("resistance" in alarm for alarm in states[0].alarms)
    assert all(not state.alarms for state in states[1:])
    assert {state.robot: state.refused for state in states} == {f"r{k}": int(k == 2) for k in range(6)}


def test_logs_of_no_robot_are_refused_and_are_no_robot(tmp_path):
    (tmp_path / "photo.csv").write_bytes(bytes(range(256)) * 20)
    texts = [write(tmp_path / "x.csv", day(0, 0.9)), str(tmp_path / "photo.csv")]
    rows = job({"r": texts[:1], "": texts[1:]}).run(["r x", " x"])
    assert [state.robot for state in robot_states(rows)] == ["r"]
    (refused,) = rows[1]["logs"]
    assert (refused["robot"], refused["path"]) == (None, texts[1])
    assert "not a text table" in refused["error"]


def test_a_refused_log_names_its_robot(tmp_path):
    texts = [write(tmp_path / f"{name}.csv", day(0, 0.9)) for name in "ab"]
    (row,) = job({"r": texts}).run(["r x"])
    assert [(log["robot"], log["error"] is None) for log in row["logs"]] == [("r", True), ("r", False)]


def test_a_robot_whose_job_was_lost_is_named(tmp_path):
    """As on a worker of a cluster that died of it: the row has an item and a reason, and nothing else."""
    good = job({"a b": [write(tmp_path / "x.csv", day(0, 0.9))]}).run(["a b 123"])
    first, second = robot_states([*good, {"path": "c d 456", "error": "KilledWorker"}])
    assert (first.robot, first.logs, first.refused, first.alarms) == ("c d", 0, 1, ("none of its logs could be used",))
    assert (second.robot, second.logs, second.alarms) == ("a b", 1, ())


def test_a_run_goes_on_with_the_robots_whose_logs_have_not_changed(tmp_path):
    fleet = {f"r{k}": [write(tmp_path / f"r{k}_0.csv", day(0, 0.9))] for k in range(2)}
    first = run_fleet(job(fleet).items, job(fleet), tmp_path / "out", batch=1)
    fleet["r1"].append(write(tmp_path / "r1_1.csv", day(1, 0.48)))
    again = run_fleet(job(fleet).items, job(fleet), tmp_path / "out", batch=1)
    assert (first.resumed, again.resumed) == (0, 1)
    assert len((tmp_path / "out" / "summary.csv").read_text().splitlines()) == 1 + 3
