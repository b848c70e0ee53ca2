"""Everything that a user may get wrong: one line on standard error that says what to change, and status 2."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest

from cli.examples import drive, pulse_test
from ohmward.cli.main import main

LOG_COMMANDS = {
    "doctor": ("doctor", "{log}"),
    "identify": ("identify", "{log}", "--capacity-ah", "12"),
    "soc": ("soc", "{log}", "--battery", "battery.toml"),
    "compare": ("compare", "{log}", "--battery", "battery.toml"),
}
SOC = ("soc", "day.csv", "--battery", "battery.toml")
IDENTIFY = ("identify", "test.csv", "--capacity-ah", "12")


def rows(count: int = 50) -> list[str]:
    return [f"{k},{-(k % 5)},{12 - 0.02 * (k % 5):.3f}" for k in range(count)]


def with_row(number: int, row: str) -> str:
    lines = rows()
    lines[number] = row
    return "\n".join(["time_s,current_A,voltage_V", *lines, ""])


BAD_LOGS = {
    "missing": (None, "there is no such file"),
    "empty": ("", "empty"),
    "header only": ("time_s,current_A,voltage_V\n", "no row"),
    "not a log": ("# Shopping\n\n- bread\n- butter\n", "column"),
    "no voltage": ("time_s,current_A\n" + "\n".join(f"{k},1" for k in range(9)), "no column for the voltage"),
    "text in numbers": (with_row(7, "7,1..5,12"), "1..5"),
    "no voltage at all": ("time_s,current_A,voltage_V\n" + "\n".join(f"{k},{k % 3}," for k in range(50)), "no value"),
    "time backwards": ("\n".join(["time_s,current_A,voltage_V", *reversed(rows()), ""]), "the time falls"),
    "two currents": (
        "time_s,current_A,I [A],voltage_V\n" + "\n".join(f"{k},1,2,12" for k in range(50)),
        "--column",
    ),
    "sign unknown": ("time_s,current_A,voltage_V\n" + "\n".join(f"{k},1,12" for k in range(50)), "--current-sign"),
}


#: Kinds and commands that refuse them; `doctor` goes on without a sign, and warns.
REFUSED = [
    (kind, command) for kind in BAD_LOGS for command in LOG_COMMANDS if (kind, command) != ("sign unknown", "doctor")
]


@pytest.mark.parametrize(("kind", "command"), REFUSED)
def test_logs_that_are_none(kind, command, here, refused):
    text, message = BAD_LOGS[kind]
    if text is not None:
        Path("bad.csv").write_text(text)
    words = [word.format(log="bad.csv") for word in LOG_COMMANDS[command]]
    assert message in refused(*words)


@pytest.mark.parametrize("command", LOG_COMMANDS)
def test_a_folder_is_no_log(command, here, refused):
    assert "folder" in refused(*(word.format(log=".") for word in LOG_COMMANDS[command]))


def test_binary_garbage(here, refused):
    Path("bad.csv").write_bytes(bytes(range(256)) * 20)
    refused("doctor", "bad.csv")


@pytest.mark.parametrize(
    ("words", "messages"),
    [
        ((*SOC, "--filter", "kf"), ("filter must be one of", "ekf")),
        ((*SOC, "--initial-soc", "80"), ("--initial-soc", "between 0 and 1", "write 0.8")),
        ((*SOC, "--initial-soc", "half"), ("--initial-soc", "finite number")),
        ((*SOC, "--initial-soc-std", "0"), ("--initial-soc-std", "above 0")),
        ((*SOC, "--truth", "soc_tru"), ("did you mean 'soc_true'",)),
        ((*SOC, "--truth", "strange"), ("between 0 and 1",)),
        ((*SOC, "--truth", "discharged_Ah"), ("--truth-start",)),
        ((*SOC, "--truth-start", "100"), ("write 1",)),
        ((*SOC, "--rest-current", "none"), ("--rest-current",)),
        ((*SOC, "--current-sign", "up"), ("--current-sign", "charge")),
        ((*SOC, "--column", "current"), ("NAME=VALUE",)),
        ((*SOC, "--column", "amps=current_A"), ("unknown quantity 'amps'",)),
        ((*SOC, "--column", "current=amperes"), ("no column 'amperes'",)),
        ((*SOC, "--unit", "current=furlong"), ("unit 'furlong'",)),
        ((*SOC, "--where", "script=1"), ("no such column",)),
        (("compare", *SOC[1:], "--filters", "ekf,kf"), ("filter must be one of",)),
        ((*IDENTIFY[:3], "-12"), ("--capacity-ah", "above 0")),
        ((*IDENTIFY[:3], "3"), ("capacity",)),
        ((*IDENTIFY, "--model", "neural"), ("model must be one of", "thevenin-2rc")),
        ((*IDENTIFY, "--n-series", "0"), ("--n-series", "at least 1")),
        ((*IDENTIFY, "--ocv", "none.csv"), ("none.csv", "there is no such file")),
        ((*IDENTIFY, "--ocv", "test.csv"), ("test.csv", "no column for the state of charge", "call it 'soc'")),
        ((*IDENTIFY, "--ocv", "ocv.csv"), ("runs from 3 to 4.19 V, but the logs usually show", "--n-series")),
        ((*IDENTIFY, "--initial-soc", "other=0.5"), ("'other'", "'test'")),
        ((*IDENTIFY, "--initial-soc", "test=50"), ("write 0.5",)),
        ((*IDENTIFY, "--idle-current", "nan"), ("--idle-current",)),
        (("demo", "--seed", "x"), ("--seed",)),
    ],
)
def test_options(words, messages, here, refused):
    text = refused(*words)
    for message in messages:
        assert message in text


@pytest.mark.parametrize("words", [SOC, IDENTIFY, ("doctor", "day.csv"), ("compare", *SOC[1:])])
def test_a_report_must_be_html_in_a_folder(words, here, refused, monkeypatch):
    monkeypatch.setattr("ohmward.logs.log.read_log", lambda *_, **__: pytest.fail("the work began"))
    assert ".html" in refused(*words, "--report", "x.pdf")
    assert "no folder 'nowhere'" in refused(*words, "--report", "nowhere/x.html")


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("x.xlsx", ".csv, .parquet or .mcap"),
        ("nowhere/x.csv", "no folder 'nowhere'"),
        ("day.csv", "is an input"),
        ("folder.csv", "this is a folder"),
        ("/proc/x.csv", "takes no files"),
    ],
)
def test_outputs_are_checked_before_the_work(output, message, here, refused, monkeypatch):
    monkeypatch.setattr("ohmward.logs.log.read_log", lambda *_, **__: pytest.fail("the work began"))
    Path("folder.csv").mkdir()
    assert message in refused(*SOC, "-o", output)


def test_a_battery_file_must_be_toml(here, refused):
    assert ".toml" in refused(*IDENTIFY, "-o", "battery.json")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("capacity_Ah", "capacity_mAh", "capacity_mAh"),
        ("capacity_Ah = 12.0", 'capacity_Ah = "12 Ah"', "capacity_Ah"),
        ("capacity_Ah = 12.0", "capacity_Ah = -12.0", "capacity_Ah"),
        ("capacity_Ah = 12.0", "capacity_Ah = ", "TOML"),
        ('format = "ohmward-battery/3"', 'format = "ohmward-battery/9"', "ohmward-battery/3"),
    ],
)
def test_battery_files_edited_by_hand(old, new, message, here, refused):
    text = Path("battery.toml").read_text()
    assert old in text
    Path("edited.toml").write_text(text.replace(old, new, 1))
    answer = refused("soc", "day.csv", "--battery", "edited.toml")
    assert "edited.toml" in answer
    assert message in answer


def test_a_battery_file_that_is_missing_or_a_log(here, refused):
    assert "nothing.toml" in refused("soc", "day.csv", "--battery", "nothing.toml")
    assert "day.csv" in refused("soc", "day.csv", "--battery", "day.csv")


def test_a_log_of_another_battery(here, refused):
    text = Path("day.csv").read_text().splitlines()
    header, *body = text
    at = header.split(",").index("voltage_V")
    cells = [line.split(",") for line in body]
    for row in cells:
        row[at] = str(4 * float(row[at]))
    Path("other.csv").write_text("\n".join([header, *(",".join(row) for row in cells), ""]))
    for command in ("soc", "compare"):
        message = refused(command, "other.csv", "--battery", "battery.toml")
        assert "seen between 9 and 12.6 V" in message
        assert "another battery" in message


def test_a_voltage_beyond_the_tests_is_said(here, as_json):
    text = Path("battery.toml").read_text()
    Path("narrow.toml").write_text(text.replace("voltage_min_V = 9.0", "voltage_min_V = 11.5"))
    notes = as_json("soc", "day.csv", "--battery", "narrow.toml")["notes"]
    assert any("outside the battery's tests, 11.5 to 12.6 V" in note for note in notes)
    notes = as_json("soc", "day.csv", "--battery", "battery.toml")["notes"]
    assert not any("outside" in note for note in notes)


def test_a_wrong_sign_is_said(here, as_json):
    notes = as_json("soc", "day.csv", "--battery", "battery.toml", "--current-sign", "discharge")["notes"]
    assert any("the data say the opposite" in note for note in notes)


def test_tests_that_cannot_identify(here, refused):
    log = pulse_test()
    np.savetxt(
        "short.csv",
        np.c_[log.time_s, log.current_A, log.voltage_V][70:74],
        delimiter=",",
        header="time_s,current_A,voltage_V",
        comments="",
    )
    message = refused("identify", "short.csv", "--capacity-ah", "12", "--current-sign", "charge")
    assert "short" in message
    log = drive()
    moving = log.current_A < -0.5
    np.savetxt(
        "moving.csv",
        np.c_[2.0 * np.arange(moving.sum()), log.current_A[moving], log.voltage_V[moving]],
        delimiter=",",
        header="time_s,current_A,voltage_V",
        comments="",
    )
    assert "moving" in refused("identify", "moving.csv", "--capacity-ah", "12", "--current-sign", "charge")


def test_all_that_a_log_lacks_is_asked_at_once_with_a_command_that_works(tmp_path, monkeypatch, refused):
    """No name of a time, a misspelled voltage, milliamperes without a unit, and a sign that nothing tells."""
    monkeypatch.chdir(tmp_path)
    current = np.where(np.arange(900) < 15, 8, 420)
    lines = [f"{k},{3.9 + 0.003 * np.cos(k) - 2e-5 * i:.3f},{i}" for k, i in enumerate(current)]
    Path("charger.csv").write_text("\n".join(["Nr,Votlage,Current", *lines, ""]))
    command = refused("doctor", "charger.csv").splitlines()[1].removeprefix("ohmward: try: ohmward ")
    assert command == (
        "doctor charger.csv --column time=Nr --column voltage=Votlage --current-sign discharge --unit current=mA"
    )
    assert main(shlex.split(command)) == 0
