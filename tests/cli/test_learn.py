"""`ohmward learn` by hand: logs in, a battery file that knows more out; nothing lost, nothing counted twice."""

import contextlib
import io
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cli.examples import battery, drive
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import load_battery, save_battery
from ohmward.battery.learning.fold import not_identified_sentences
from ohmward.cli.doctor import sources
from ohmward.cli.main import main
from ohmward.fleet import learning
from ohmward.logs import write_log

#: Keys of --json, of a battery file in it, of one state of that, and of a log.
KEYS = {"command", "battery", "dry_run", "output", "report", "learnt", "seen", "set_aside", "hours", "files", "logs"}
KEYS |= {"resumed", "seconds", "notes"}
FILE_KEYS = {"output", "written", "backup", "name", "serial_number", "before", "after"}
STATE_KEYS = {"capacity_Ah", "resistance_ohm", "current_offset_A", "ocv_std_V", "logs", "hours"}
LOG_KEYS = {"path", "serial_number", "battery_file", "log", "verdict", "reason", "hours", "soc_min", "soc_max", "notes"}
LOG_KEYS |= {"soc_start", "soc_end", "capacity_Ah", "resistance_ohm", "offset_A", "information", "residual_rms_V"}
LOG_KEYS |= {"anchors", "left_out"}


def save_label(folder: Path) -> None:
    save_battery(generic_battery("nmc", 12.0, 3), folder / "label.toml")


@pytest.fixture
def label(here) -> Path:
    """A folder with label.toml, a file that knows the label of the battery."""
    save_label(here)
    return here


def taught(folder: Path, files: Path, *logs: str) -> dict[str, Any]:
    """mine.toml in an empty folder learns from logs after label.toml, with a page; what the command says in JSON."""
    save_label(folder)
    shutil.copy(folder / "label.toml", folder / "mine.toml")
    words = ["learn", *(str(files / log) for log in logs), "--battery", str(folder / "mine.toml")]
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main([*words, "-o", str(folder / "mine.toml"), "--report", str(folder / "learn.html"), "--json"]) == 0
    return json.loads(out.getvalue())


@pytest.fixture(scope="module")
def day_learnt(files, tmp_path_factory) -> tuple[Path, dict[str, Any]]:
    """A folder in which mine.toml has learnt from day.csv, and what the command said; nobody writes into it."""
    folder = tmp_path_factory.mktemp("day")
    return folder, taught(folder, files, "day.csv")


@pytest.fixture(scope="module")
def both_learnt(files, tmp_path_factory) -> Path:
    """A folder in which mine.toml has learnt from day.csv and test.csv; nobody writes into it."""
    folder = tmp_path_factory.mktemp("both")
    taught(folder, files, "day.csv", "test.csv")
    return folder


def interrupt_after(count: int, monkeypatch) -> None:
    """Interrupt the run when it begins its next log after so many."""
    real, begun = learning.learn, []

    def learn(*args, **options):
        begun.append(args)
        if len(begun) > count:
            raise KeyboardInterrupt
        return real(*args, **options)

    monkeypatch.setattr(learning, "learn", learn)


def test_a_log_narrows_the_file_and_the_file_before_stays(day_learnt):
    folder, found = day_learnt
    assert (found["learnt"], found["seen"], found["set_aside"]) == (1, 0, 0)
    (file,) = found["files"]
    assert file["backup"] == str(folder / "mine.toml.bak")
    assert (folder / "mine.toml.bak").read_text() == (folder / "label.toml").read_text()
    before, after = file["before"], file["after"]
    assert after["resistance_ohm"]["std"] < 0.5 * before["resistance_ohm"]["std"]
    assert after["ocv_std_V"] == pytest.approx(before["ocv_std_V"], rel=0.02)  # two hours do not show the curve
    assert after["logs"] == 1 and after["hours"] == pytest.approx(2.0, abs=0.01)
    truth = battery().thevenin
    assert truth is not None
    known = load_battery(folder / "mine.toml")
    assert known.capacity_Ah == pytest.approx(truth.capacity_Ah, rel=0.05)
    assert sorted(path.name for path in folder.iterdir() if path.name.startswith(".")) == []


def test_json_has_the_keys_of_the_page_and_a_start_for_a_log_that_is_not_there_is_named(label, as_json):
    found = as_json("learn", "day.csv", "--battery", "label.toml", "--initial-soc", "dya=0.9")
    assert found["notes"] == ["warning: --initial-soc dya: there is no log of this name"]
    assert set(found) == KEYS
    (file,), (log,) = found["files"], found["logs"]
    assert set(file) == FILE_KEYS and set(file["before"]) == set(file["after"]) == STATE_KEYS
    assert set(log) >= LOG_KEYS
    assert log["verdict"] == "learnt" and log["soc_min"] < log["soc_max"]
    assert file["output"] is None and not file["written"]


def test_a_log_that_was_learnt_is_not_counted_again(here, day_learnt, as_json):
    once = day_learnt[0] / "mine.toml"
    found = as_json("learn", "day.csv", "--battery", str(once), "-o", "twice.toml")
    assert found["seen"] == 1 and found["logs"][0]["reason"] == "the battery has learnt from it before"
    assert Path("twice.toml").read_text() == once.read_text()


def test_a_test_that_identified_the_battery_does_not_teach_it_once_more(label, as_json):
    tested = ("test.csv", "--capacity-ah", "12", "--n-series", "3", "--chemistry", "nmc", "--model", "thevenin-1rc")
    as_json("identify", *tested, "-o", "tested.toml")
    found = as_json("learn", "test.csv", "day.csv", "--battery", "tested.toml")
    assert [log["verdict"] for log in found["logs"]] == ["seen", "learnt"]


def test_a_dry_run_writes_no_battery_file(label, capsys):
    assert main(["learn", "day.csv", "--battery", "label.toml", "-o", "new.toml", "--dry-run"]) == 0
    assert "No battery file written: --dry-run." in capsys.readouterr().out
    assert not Path("new.toml").exists() and not list(label.glob(".*"))


def test_an_interrupted_run_goes_on_and_ends_with_the_same_file(label, both_learnt, as_json, monkeypatch):
    words = ("learn", "day.csv", "test.csv", "--battery", "label.toml", "-o")
    with monkeypatch.context() as context:
        interrupt_after(1, context)
        assert main([*words, "part.toml"]) == 130
    assert not Path("part.toml").exists()
    found = as_json(*words, "part.toml")
    assert found["resumed"] == 1 and found["learnt"] == 2
    assert Path("part.toml").read_text() == (both_learnt / "mine.toml").read_text()


def test_a_run_with_other_options_begins_anew(label, as_json, monkeypatch):
    words = ("learn", "day.csv", "test.csv", "--battery", "label.toml", "-o", "part.toml")
    with monkeypatch.context() as context:
        interrupt_after(1, context)
        assert main(list(words)) == 130
    assert as_json(*words, "--initial-soc", "day=0.9")["resumed"] == 0


def test_a_run_with_another_log_beside_begins_anew(label, as_json, monkeypatch):
    """What is learnt from a log depends on the logs before it."""
    words = ("learn", "day.csv", "test.csv", "--battery", "label.toml", "-o", "part.toml")
    with monkeypatch.context() as context:
        interrupt_after(1, context)
        assert main(list(words)) == 130
    shutil.copy("day.csv", "other.csv")
    assert as_json(*words[:3], "other.csv", *words[3:])["resumed"] == 0


def bad_logs(folder: Path) -> None:
    """Four logs that must not spoil the file."""
    day = drive()
    write_log(replace(day, current_A=-day.current_A), folder / "sign.csv")
    write_log(replace(day, voltage_V=day.voltage_V * 4 / 3), folder / "cells.csv")
    stuck = day.voltage_V.copy()
    stuck[300:] = stuck[300]
    write_log(replace(day, voltage_V=stuck), folder / "stuck.csv")
    lines = (folder / "day.csv").read_text().splitlines()
    (folder / "clock.csv").write_text("\n".join(lines[:2000] + lines[500:]) + "\n")
    (folder / "words.csv").write_text("nothing\nto see\n")


def test_bad_logs_are_set_aside_with_their_reasons_on_the_page_too_and_the_file_stays(label, capsys, as_json):
    bad_logs(label)
    shutil.copy("label.toml", "mine.toml")
    logs = ["sign.csv", "cells.csv", "stuck.csv", "clock.csv", "words.csv"]
    options = ["--current-sign", "charge", "--battery", "mine.toml", "-o", "mine.toml"]
    assert main(["learn", *logs, *options]) == 1
    text = " ".join(capsys.readouterr().out.split())
    for reason in (
        "sign, set aside: the voltage answers the current with the wrong sign",
        "cells, set aside: its usual voltage,",
        "another number of cells in series?",
        "stuck, set aside: the sensor of the voltage was stuck for 1.8 of 2 h",
        "clock, set aside: clock.csv holds several recordings: the time falls",
        "words, set aside:",
        "battery file: mine.toml, nothing new",
    ):
        assert reason in text
    assert Path("mine.toml").read_text() == Path("label.toml").read_text()
    assert not Path("mine.toml.bak").exists()
    found = as_json("learn", *logs, "day.csv", *options, "--report", "learn.html")
    assert found["set_aside"] == 5 and found["learnt"] == 1
    page = Path("learn.html").read_text(encoding="utf-8")
    for part in (
        "Open-circuit voltage",
        "Resistance to 10 s of current",
        "Capacity",
        "before",
        "after",
        "sign was set",
    ):
        assert part in page


def with_serial(name: str, serials: list[str]) -> None:
    """A copy of day.csv with a serial number in each row, each for an equal share of the rows."""
    head, *rows = Path("day.csv").read_text().splitlines()
    share = -(-len(rows) // len(serials))
    lines = [f"{row},{serials[k // share]}" for k, row in enumerate(rows)]
    Path(name).write_text("\n".join([f"{head},battery_serial", *lines]) + "\n")


def test_each_serial_number_has_a_file_of_its_own(label, as_json):
    with_serial("both.csv", ["A1", "B2"])
    found = as_json("learn", "both.csv", "day.csv", "--battery", "label.toml", "-o", "fleet/")
    assert [file["serial_number"] for file in found["files"]] == ["A1", "B2"]
    assert [log["verdict"] for log in found["logs"]] == ["learnt", "learnt", "set aside"]
    assert "no serial number" in found["logs"][2]["reason"]
    assert load_battery("fleet/A1.toml").serial_number == "A1"
    again = as_json("learn", "both.csv", "--battery", "label.toml", "-o", "fleet/")
    assert again["seen"] == 2
    assert sorted(path.name for path in Path("fleet").iterdir()) == ["A1.toml", "B2.toml"]


def test_a_log_of_another_serial_number_is_set_aside(label, as_json):
    with_serial("a.csv", ["A1"])
    with_serial("b.csv", ["B2"])
    found = as_json("learn", "a.csv", "b.csv", "--battery", "label.toml", "-o", "a.toml")
    assert [log["verdict"] for log in found["logs"]] == ["learnt", "set aside"]
    assert (
        "this is not the battery of the file: the log is of serial number B2, the file of A1"
        in (found["logs"][1]["reason"])
    )
    assert load_battery("a.toml").serial_number == "A1"


def test_a_log_of_two_batteries_needs_a_choice(label, as_json):
    with_serial("both.csv", ["A1", "B2"])
    found = as_json("learn", "both.csv", "--battery", "label.toml")
    assert "choose one with --where battery_serial=A1, or give a folder" in found["logs"][0]["reason"]
    found = as_json("learn", "both.csv", "--battery", "label.toml", "--where", "battery_serial=B2")
    assert found["files"][0]["serial_number"] == "B2"


def test_the_file_no_longer_says_what_it_has_learnt_since(here, both_learnt, as_json):
    new = load_battery(both_learnt / "mine.toml")
    everything, capacity, resistances, *_ = new.not_identified
    assert everything.startswith("everything that no log has shown: start values that cells of lithium nickel")
    assert capacity.endswith("(95 %) from 2 logs")
    assert resistances.startswith("resistances: learnt within a factor of 1.")
    assert sources(new)["learnt from"] == "2 logs, 6.0 h"
    assert new.knowledge is not None
    unplaced = replace(new, knowledge=replace(new.knowledge, seen_from_soc=1.0))
    assert not_identified_sentences(unplaced)[3].startswith("open-circuit voltage: that of the file")
    as_json("learn", "test.csv", "--battery", "battery.toml", "-o", "tested.toml")
    assert load_battery("tested.toml").not_identified == load_battery("battery.toml").not_identified


def test_only_what_is_new_of_a_log_is_learnt(label, as_json):
    write_log(drive().select(slice(0, 1800)), label / "morning.csv")
    found = as_json("learn", "morning.csv", "day.csv", "--battery", "label.toml")
    first, second = found["logs"]
    assert first["left_out"] == [] and first["hours"] == pytest.approx(1.0, abs=0.01)
    assert second["left_out"] == ["1 of 2 h: the battery has learnt from them before"]
    assert second["hours"] == pytest.approx(1.0, abs=0.01)
    assert any("day: 1 of 2 h" in note for note in found["notes"])


def test_patterns_and_folders_name_logs_in_order(label, as_json):
    folder = label / "logs"
    folder.mkdir()
    day = drive()
    for k, rows in enumerate((slice(0, 1800), slice(1800, None))):
        write_log(day.select(rows), folder / f"{k}.csv")
    names = [log["log"] for log in as_json("learn", "logs", "--battery", "label.toml")["logs"]]
    assert names == ["0", "1"]
    found = as_json("learn", "logs/*.csv", "day.csv", "--battery", "label.toml")
    assert [log["verdict"] for log in found["logs"]] == ["learnt", "learnt", "seen"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.csv", "--battery", "label.toml"], "no file matches 'nowhere.csv'"),
        (["day.csv", "--battery", "nowhere.toml"], "cannot be read"),
        (["day.csv", "--battery", "label.toml", "-o", "new.txt"], "must end in .toml"),
        (["day.csv", "--battery", "label.toml", "-o", "no/new.toml"], "there is no folder"),
        (["day.csv", "--battery", "label.toml", "--initial-soc", "90"], "for 90 % write 0.9"),
        (["empty", "--battery", "label.toml"], "holds no log"),
    ],
)
def test_refusals_come_before_the_work(label, refused, words, message):
    (label / "empty").mkdir()
    assert message in refused("learn", *words)
    assert not list(label.glob("*.bak"))
