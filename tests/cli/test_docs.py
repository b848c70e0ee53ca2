"""What the documentation shows runs; what it lists is what there is."""

import re
import shlex
from pathlib import Path

from cli import test_calibrate, test_health, test_slip, test_twin
from cli.test_soc import KEYS, SCORES
from markdown_pages import redirected
from ohmward.cli.main import COMMANDS, main
from ohmward.fleet import RobotRecord

DOCS = Path(__file__).parents[2] / "docs"


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), flags=re.DOTALL)


def test_the_command_lines_of_the_tutorial_can_be_pasted_one_after_the_other(here, short_drives, monkeypatch, capsys):
    monkeypatch.setattr("ohmward.battery.soc.comparison.available", lambda battery: ("coulomb", "ekf"))
    for line in (line for block in blocks("tutorial.md", "bash") for line in block.splitlines()):
        (program, *words), file = redirected(shlex.split(line))
        assert program == "ohmward"
        assert main(words) == 0, line
        printed = capsys.readouterr().out
        if file:
            (here / file).write_text(printed, encoding="utf-8")


def test_the_script_of_the_tutorial_runs(here, capsys):
    (script,) = blocks("tutorial.md", "python")
    exec(script, {})
    assert re.fullmatch(r"4\d\.\d% ± \d\.\d%\n", capsys.readouterr().out)


def test_every_command_is_in_the_table():
    table = (DOCS / "command-line.md").read_text(encoding="utf-8").split("\n\n")[1]
    assert sorted(re.findall(r"^\| `ohmward (\w+)", table, flags=re.MULTILINE)) == sorted(COMMANDS)


def section(command: str) -> str:
    text = (DOCS / "command-line.md").read_text(encoding="utf-8")
    return re.split(r"^## ", text.split(f"## JSON of `{command}`")[1], flags=re.MULTILINE)[0]


def listed(command: str) -> set[str]:
    return set(re.findall(r"`(\w+)`", section(command)))


def test_keys_of_soc_are_all_listed():
    assert listed("soc") >= KEYS | SCORES


def test_keys_of_slip_are_all_listed():
    assert listed("slip") >= test_slip.KEYS | test_slip.SCORES


def test_keys_of_health_are_all_listed():
    assert listed("health") >= test_health.KEYS | test_health.LOG_KEYS


def test_keys_of_twin_are_all_listed():
    assert listed("twin") >= test_twin.KEYS


def test_keys_of_calibrate_are_all_listed():
    assert listed("calibrate") >= test_calibrate.KEYS


def test_keys_of_compare_are_all_listed(here, as_json):
    found = as_json("compare", "day.csv", "--battery", "battery.toml", "--filters", "ekf")
    own = set(found["estimators"]["ekf"]) - SCORES - {f"{name}_after_1h" for name in SCORES}
    assert listed("compare") >= set(found) | own


def test_keys_of_export_are_all_listed(here, as_json):
    assert listed("export") >= set(as_json("export", "battery.toml", "--filter", "textbook-ekf", "-o", "soc"))


def test_keys_of_fleet_are_all_listed(here, as_json):
    found = as_json(
        "fleet", "day.csv", "--battery", "battery.toml", "--filter", "coulomb", "-o", "out", "--processes", "1"
    )
    of_robots = {field for field in RobotRecord._fields if not field.endswith("_std")}
    assert listed("fleet") >= set(found) | of_robots | {"robots", "report"}


def test_keys_of_doctor_are_all_listed(here, as_json):
    found = as_json("doctor", "day.csv")
    assert listed("doctor") >= set(found) | set(found["logs"][0]) | set(found["logs"][0]["survey"])


def test_keys_of_identify_are_all_listed(here, as_json):
    found = as_json("identify", "test.csv", "--capacity-ah", "12", "--model", "thevenin-1rc")
    assert listed("identify") >= set(found) | set(found["logs"][0]) | set(found["parameters"][0])
