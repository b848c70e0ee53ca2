import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli.examples import drive
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import save_battery
from ohmward.battery.models.noise import BatteryNoise
from ohmward.cli.battery_inputs import reading_words
from ohmward.cli.doctor import sources
from ohmward.cli.main import main
from ohmward.logs import Log, write_log
from ohmward.logs.log import ReadOptions
from ohmward.traction import RLMA, save_robot


def test_what_it_says(here, capsys):
    assert main(["doctor", "test.csv"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("test: 1,437 samples in 3 h 59 min\n")
    assert "current      -12 to 0 A; > 0 charges" in out
    assert "0 Ah in, 11.25 Ah out" in out
    assert "positive current charges the battery" in out


def test_json_has_one_entry_for_each_log(here, as_json):
    found = as_json("doctor", "test.csv", "day.csv")
    assert [log["path"] for log in found["logs"]] == ["test.csv", "day.csv"]
    log = found["logs"][1]
    assert set(log) == {"path", "name", "survey", "findings", "notes", "worst"}
    assert log["survey"]["samples"] == 3600
    assert log["survey"]["activity"]["charge_out_Ah"] == pytest.approx(-min(drive().charge_Ah()), rel=0.05)


def test_an_error_in_a_log_gives_status_1(tmp_path, capsys):
    time_s = np.arange(200.0)
    write_log(Log("x", time_s, np.full(200, -1.0), 12.0 - 0.001 * time_s), tmp_path / "x.csv")
    assert main(["doctor", str(tmp_path / "x.csv"), "--current-sign", "charge"]) == 1
    said = capsys.readouterr().out
    assert "error: the current never changes" in said and "Next" not in said


def test_a_file_that_cannot_be_used_hides_no_other(here, as_json, capsys):
    Path("empty.csv").write_text("")
    found = as_json("doctor", "empty.csv", "day.csv")
    assert [log["path"] for log in found["logs"]] == ["day.csv"]
    (refused,) = found["refused"]
    assert refused["path"] == "empty.csv" and "the file is empty" in refused["error"]
    assert main(["doctor", "empty.csv", "day.csv"]) == 1
    assert "Could not be used:\n  - empty.csv: the file is empty" in capsys.readouterr().out
    assert main(["doctor", "empty.csv", "none.csv"]) == 2


def test_the_sign_can_be_given(here, as_json):
    charged = as_json("doctor", "day.csv")["logs"][0]["survey"]["activity"]["charge_out_Ah"]
    reversed_ = as_json("doctor", "day.csv", "--current-sign", "discharge")["logs"][0]
    assert reversed_["survey"]["activity"]["charge_in_Ah"] == pytest.approx(charged)
    assert reversed_["worst"] == "error"


def test_a_selection_can_stand_behind_the_file(tmp_path, as_json):
    log = drive()
    part = np.where(log.time_s < 3600.0, 1.0, 2.0)
    write_log(Log("x", log.time_s, log.current_A, log.voltage_V, extra={"script": part}), tmp_path / "x.csv")
    found = as_json("doctor", f"{tmp_path}/x.csv:script=1", f"{tmp_path}/x.csv:script=2")["logs"]
    assert [log["name"] for log in found] == ["x:script=1", "x:script=2"]
    assert [log["survey"]["samples"] for log in found] == [1800, 1800]


def test_columns_and_units_can_be_named(tmp_path, as_json):
    (tmp_path / "x.csv").write_text("t,a,b\n" + "".join(f"{k},{3700 - (k % 7)},{-(k % 7)}\n" for k in range(300)))
    words = ("--column", "voltage=a", "--unit", "voltage=mV", "--column", "current=b", "--unit", "current=A")
    survey = as_json("doctor", str(tmp_path / "x.csv"), *words)["logs"][0]["survey"]
    assert survey["voltage"]["maximum"] == pytest.approx(3.7)


def test_a_battery_file_says_what_it_does_not_know_and_which_test_helps(here, capsys):
    save_battery(generic_battery("nmc", 12.0, 4), here / "generic.toml")
    assert main(["doctor", "generic.toml"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("generic.toml: battery 'generic nmc', 12 Ah, nmc, 4 in series\n")
    assert "learnt from     none" in out and "assumed exact   hysteresis_std: 0 in [noise]" in out
    for part in ("Not known:", "25 degC", "-10 degC", "as the file is", "at best, after a slow discharge"):
        assert part in out


def test_files_of_all_kinds_have_bands_a_page_and_next_commands_with_their_names(here, as_json):
    Path("drive.csv").write_text(_drive_text(), encoding="utf-8")
    save_robot(RLMA, here / "mine.toml")
    (here / "pack.toml").symlink_to(here / "battery.toml")
    found = as_json("doctor", "drive.csv", "day.csv", "mine.toml", "pack.toml", "--report", "found.html")
    assert [log["path"] for log in found["logs"]] == ["day.csv"]
    commands = ["ohmward slip drive.csv --robot mine.toml", "ohmward soc day.csv --battery pack.toml"]
    assert found["next"][:2] == commands
    (battery,) = found["batteries"]
    assert [band["temperature_degC"] for band in battery["bands"]] == [25.0, 0.0, -10.0]
    assert all(0.0 < band["known_start"] <= 1.05 * band["unknown_start"] < 10.0 for band in battery["bands"])
    assert "as the file is" in (here / "found.html").read_text(encoding="utf-8")


def test_a_robot_file_and_a_setup_are_examined_with_the_next_command(here, as_json, capsys):
    save_robot(RLMA, here / "mine.toml")
    (here / "setup.toml").write_text(
        'format = "ohmward-setup/1"\nbattery = "battery.toml"\n[[source]]\nkind = "json-lines"\n'
    )
    found = as_json("doctor", "mine.toml", "setup.toml", "rlma")
    assert [(robot["path"], robot["chassis"]) for robot in found["robots"]] == [
        ("mine.toml", "Differential"),
        ("rlma", "Differential"),
    ]
    assert [(setup["estimates"], setup["sources"]) for setup in found["setups"]] == [("charge", "json-lines")]
    commands = ["slip LOG --robot mine.toml", "run setup.toml --check", "slip LOG --robot rlma"]
    assert found["next"] == [f"ohmward {command}" for command in commands]
    assert main(["doctor", "mine.toml", "setup.toml"]) == 0
    assert "Next:\n  - ohmward slip LOG --robot mine.toml" in capsys.readouterr().out


def test_a_damaged_file_of_toml_is_refused_with_its_kind(here, refused):
    (here / "robot.toml").write_text('format = "ohmward-robot/1"\n')
    assert "robot.toml" in refused("doctor", "robot.toml")
    (here / "floors.toml").write_text('format = "ohmward-floors/1"\n')
    assert "floors file; give a battery file" in refused("doctor", "floors.toml")


def test_what_a_battery_file_takes_as_exact_is_named():
    careless = replace(generic_battery("lfp", 12.0, 4), noise=BatteryNoise(capacity_std=0.0))
    exact = "capacity_std, activation_std_K, ocv_std_V_per_K, hysteresis_std: 0 in [noise]"
    assert sources(careless)["assumed exact"] == exact


def _drive_text() -> str:
    rows = [f"{0.05 * k:.2f},{np.sin(k / 50):.4f},{1.1 * np.sin(k / 50):.4f}" for k in range(400)]
    return "\n".join(["time_s,velL_rad_s,velR_rad_s", *rows, ""])


def test_a_drive_is_examined(here, as_json, capsys):
    Path("drive.csv").write_text(_drive_text(), encoding="utf-8")
    found = as_json("doctor", "drive.csv", "--report", "found.html")
    (log,) = found["drives"]
    assert (found["logs"], log["survey"]["samples"]) == ([], 400)
    assert log["survey"]["wheels"]["right"]["maximum"] == pytest.approx(1.1, rel=1e-3)
    assert [finding["text"] for finding in log["findings"]] == [
        "neither motor currents nor a speed from outside",
        "no gyro",
    ]
    assert found["next"] == [
        "ohmward robot --radius M --track M --mass KG -o robot.toml",
        "ohmward slip drive.csv --robot robot.toml",
    ]
    assert "Wheels" in (here / "found.html").read_text(encoding="utf-8")
    assert main(["doctor", "drive.csv"]) == 0
    out = capsys.readouterr().out
    assert re.search("wheel left +.* rad/s\n", out) and "; no gaps\n" in out
    assert out.count("neither motor currents nor") == 1


def test_a_finding_is_not_listed_as_an_assumption_too(tmp_path, capsys):
    lines = [
        "time_s,current_A,voltage_V",
        *(f"{k},{'' if k == 50 else -(k // 10 % 2)},{3.8 - k // 10 % 2 / 10}" for k in range(100)),
    ]
    (tmp_path / "a.csv").write_text("\n".join(lines), encoding="utf-8")
    main(["doctor", str(tmp_path / "a.csv")])
    assert capsys.readouterr().out.count("current: no number in 1 of 100 values") == 1


def test_a_drive_with_a_speed_from_outside_shows_the_sizes_of_its_robot(here, as_json):
    head, *rows = _drive_text().splitlines()
    text = "\n".join([f"{head},gnss_speed_m_s", *(f"{row},0.1" for row in rows), ""])
    Path("drive.csv").write_text(text, encoding="utf-8")
    assert as_json("doctor", "drive.csv")["next"][0] == "ohmward robot drive.csv --mass KG -o robot.toml"


def test_a_drive_is_checked_with_its_robot(here, as_json):
    Path("drive.csv").write_text(_drive_text().replace("velL_rad_s", "velL_rpm"), encoding="utf-8")
    found = as_json("doctor", "drive.csv", "--robot", "rlma", "--unit", "wheel_speed=rpm")
    assert found["next"] == ["ohmward slip drive.csv --robot rlma --unit wheel_speed=rpm"]
    (log,) = found["drives"]
    assert set(log["survey"]["wheels"]) == {"front_left", "front_right"}
    assert log["survey"]["wheels"]["front_right"]["maximum"] == pytest.approx(1.1 * np.pi / 30, rel=1e-3)


def test_a_wheel_that_never_turns_and_one_that_never_changes_are_named(here, as_json):
    rows = "".join(f"{k},3,{k % 7}\n" for k in range(50))
    Path("dead.csv").write_text(f"time_s,velL,velR\n{rows}", encoding="utf-8")
    found = as_json("doctor", "dead.csv")
    texts = [finding["text"] for finding in found["drives"][0]["findings"]]
    assert (
        "the wheel left never changes (3 rad/s)" in texts
        and "a sample comes 1 times a second; at least 5 are needed" in texts
    )
    Path("still.csv").write_text("time_s,velL,velR\n" + "".join(f"{k},0,0\n" for k in range(50)), encoding="utf-8")
    assert main(["doctor", "still.csv"]) == 1


def test_a_log_of_battery_and_wheels_is_both(here, as_json):
    log = drive()
    rows = zip(log.time_s, log.current_A, log.voltage_V, np.sin(log.time_s), np.cos(log.time_s), strict=True)
    lines = ["time_s,current_A,voltage_V,velL_rad_s,velR_rad_s", *(",".join(f"{v:.4f}" for v in row) for row in rows)]
    Path("both.csv").write_text("\n".join(lines))
    found = as_json("doctor", "both.csv", "--unit", "wheel_speed=rad/s", "--unit", "current=A")
    assert (len(found["logs"]), len(found["drives"])) == (1, 1)
    of_drive, of_both = "--unit wheel_speed=rad/s", "--unit wheel_speed=rad/s --unit current=A"
    assert found["next"][-2:] == [
        f"ohmward slip both.csv --robot robot.toml {of_drive}",
        f"ohmward mission both.csv --robot robot.toml --battery battery.toml {of_both}",
    ]


def test_the_next_command_reads_the_log_as_this_one_did(here, as_json, capsys):
    lines = Path("day.csv").read_text().splitlines()[1:]
    Path("my day.csv").write_text("\n".join(lines))
    names = ",".join(["time_s", "current_A", "voltage_V", *(f"c{k}" for k in range(lines[0].count(",") - 2))])
    words = ["--names", names, "--current-sign", "charge", "--from", "60", "--temperature", "20", "--sort-time"]
    *_, command = as_json("doctor", "my day.csv", *words)["next"]
    assert main(shlex.split(command)[1:]) == 0


def test_the_next_command_names_topics_by_their_option():
    where = (("topic", "/a"), ("exp", "5"))
    assert reading_words(ReadOptions(where=where)) == ["--topic", "/a", "--where", "exp=5"]


def test_many_logs_are_those_of_a_fleet(here, as_json):
    Path("logs").mkdir()
    for k in range(11):
        Path(f"logs/{k}.csv").write_text(Path("day.csv").read_text())
    words = [*map(str, sorted(Path("logs").iterdir())), "--current-sign", "charge"]
    command = "ohmward fleet logs --battery battery.toml --current-sign charge -o results"
    assert as_json("doctor", *words)["next"] == [command]


def test_a_folder_of_several_robots_is_that_of_a_fleet(here, refused):
    Path("logs").mkdir()
    for robot in ("r1", "r2"):
        header, *rows = Path("day.csv").read_text().splitlines()
        Path(f"logs/{robot}.csv").write_text("\n".join([f"{header},robot_id", *(f"{row},{robot}" for row in rows)]))
    assert "ohmward fleet logs --battery battery.toml -o results" in refused("doctor", "logs")


def test_a_battery_file_is_made_first_where_there_is_none(here, as_json, refused):
    Path("battery.toml").unlink()
    make, learn, estimate = as_json("doctor", "day.csv")["next"]
    assert make == "ohmward generic --capacity-ah AH --chemistry CHEMISTRY --n-series N -o battery.toml"
    assert learn == "ohmward learn day.csv --battery battery.toml -o battery.toml"
    assert "make one with `ohmward generic`" in refused(*shlex.split(estimate)[1:])


def test_a_working_day_with_many_rests_is_no_test(here, as_json):
    assert as_json("doctor", "test.csv")["next"][0].startswith("ohmward identify test.csv --capacity-ah AH")
    work_A = np.where(np.arange(100) < 50, 0.0, -4.0 - np.arange(100) % 3)
    current_A = np.tile(work_A, 20)
    voltage_V = 13.2 + 0.03 * current_A + 1e-5 * np.cumsum(current_A)
    write_log(Log("work", 1.0 * np.arange(current_A.size), current_A, voltage_V), here / "work.csv")
    found = as_json("doctor", "work.csv")
    activity = found["logs"][0]["survey"]["activity"]
    assert min(activity["rests"], activity["pulses"]) >= 5
    assert [command.split()[1] for command in found["next"]] == ["soc"]


def test_a_drive_that_cannot_be_read_says_what_is_missing(here, refused):
    Path("counts.csv").write_text("time_s,left_ticks,right_ticks\n0,1,1\n1,2,2\n2,3,3\n", encoding="utf-8")
    said = refused("doctor", "counts.csv")
    assert "--counts-per-turn" in said and "As the log of a battery: counts.csv: no column for the current" in said


def test_a_drive_of_unknown_columns_says_which_to_name(here, refused):
    Path("x.csv").write_text("time_s,wheel_left,wheel_right\n0,1,1\n1,2,2\n2,3,3\n", encoding="utf-8")
    assert "--column left_wheel_speed=wheel_left --column right_wheel_speed=wheel_right" in refused("doctor", "x.csv")


def test_speeds_in_rpm_that_name_no_wheel_are_asked_about_as_a_drive(here, as_json, refused):
    rows = "".join(f"{k / 10},{k % 7},{k % 5}\n" for k in range(200))
    Path("x.csv").write_text(f"time_s,n_left (rpm),n_right (rpm)\n{rows}", encoding="utf-8")
    assert "--column 'left_wheel_speed=n_left (rpm)'" in refused("doctor", "x.csv")
    named = ["--column", "left_wheel_speed=n_left (rpm)", "--column", "right_wheel_speed=n_right (rpm)"]
    (drive,) = as_json("doctor", "x.csv", *named)["drives"]
    assert list(drive["survey"]["wheels"]) == ["left", "right"]


def test_speeds_at_the_rim_need_no_radius(here, as_json):
    Path("x.csv").write_text("time_s,left_m_s,right_m_s\n0,1,1\n0.1,2,2\n0.2,3,3\n", encoding="utf-8")
    (drive,) = as_json("doctor", "x.csv")["drives"]
    assert drive["survey"]["wheels"]["left"]["maximum"] == 3.0
    assert any("the radius of the wheels is not known" in note for note in drive["notes"])


def _write_pack(path, header, sign=1.0):
    """A drive of a pack of three cells, with the row of their voltages, as `header` calls them."""
    log = drive()
    rows = zip(log.time_s, *[log.voltage_V / 3.0] * 3, sign * log.current_A, log.voltage_V, strict=True)
    path.write_text("\n".join([header, *(",".join(f"{value:.4f}" for value in row) for row in rows)]))


@pytest.mark.parametrize("header", ["t_s,V1,V2,V3,Ibat,Vtot", "t_s,Speed1,Speed2,Speed3,I_pack [A],U_total [V]"])
def test_a_battery_with_cells_or_speeds_is_no_drive(tmp_path, as_json, header):
    _write_pack(tmp_path / "x.csv", header)
    (log,) = as_json("doctor", str(tmp_path / "x.csv"))["logs"]
    assert log["survey"]["activity"]["charge_out_Ah"] == pytest.approx(-min(drive().charge_Ah()), rel=0.05)


def test_numbered_voltages_beside_a_current_are_cells(tmp_path, as_json):
    _write_pack(tmp_path / "x.csv", "t_s,V1,V2,V3,Ibat,index")
    found = as_json("doctor", str(tmp_path / "x.csv"))
    (log,) = found["logs"]
    assert any("--n-series 3" in command for command in found["next"])
    assert log["survey"]["voltage"]["maximum"] == pytest.approx(drive().voltage_V.max(), rel=1e-3)


def test_a_log_whose_sign_nobody_tells_is_examined_all_the_same(tmp_path, as_json):
    (tmp_path / "x.csv").write_text("t_s,current_A,voltage_V\n" + "".join(f"{k},{k % 7},12.0\n" for k in range(300)))
    (log,) = as_json("doctor", str(tmp_path / "x.csv"))["logs"]
    assert log["survey"]["samples"] == 300
    assert any("say it with --current-sign" in note and note.startswith("warning") for note in log["notes"])


def test_what_is_said_of_a_battery_does_not_call_it_a_drive(tmp_path, capsys):
    _write_pack(tmp_path / "x.csv", "t_s,V1,V2,V3,Ibat,Vtot")
    assert main(["doctor", str(tmp_path / "x.csv"), "--unit", "current=mV"]) == 2
    assert "looks like a drive" not in capsys.readouterr().err


def test_cells_called_like_speeds_are_no_wheels(here, as_json):
    log = drive()
    cells = {f"V{k}": log.voltage_V / 4 for k in range(1, 5)}
    write_log(replace(log, extra=cells), "cells.csv")
    found = as_json("doctor", "cells.csv")
    assert found["drives"] == []
    assert not any("also a drive" in note for note in found["logs"][0]["notes"])
    write_log(replace(log, extra=cells | {"Speed1": log.time_s, "Speed2": log.time_s}), "cells.csv")
    (of_speeds,) = as_json("doctor", "cells.csv")["drives"]
    assert set(of_speeds["survey"]["wheels"]) == {"1", "2"}


def test_a_log_that_is_called_as_a_robot_is_the_log(here, as_json):
    Path("day.csv").rename("husky")
    assert [log["name"] for log in as_json("doctor", "husky")["logs"]] == ["husky"]
    Path("husky").unlink()
    assert as_json("doctor", "husky")["robots"]


def test_a_robot_makes_a_file_without_known_columns_a_drive(tmp_path, refused):
    (tmp_path / "x.csv").write_text("t,a,b\n0,1,1\n1,1,1\n2,1,1\n")
    assert "no column for the speed of a wheel found" in refused("doctor", str(tmp_path / "x.csv"), "--robot", "rlma")
