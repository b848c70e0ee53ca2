"""The front page keeps its promises: its commands exist, its numbers come from the benchmark, its picture is whole."""

import re
from importlib.util import module_from_spec, spec_from_file_location
from types import ModuleType
from xml.etree import ElementTree

import numpy as np
import pytest

from markdown_pages import ROOT, command_lines, links, programs, redirected
from ohmward import make_robot_day, score, write_log
from ohmward.cli.main import main
from ohmward.traction import RLMA

README = ROOT / "README.md"
BENCHMARK = """\
# Accuracy

| data | method | start | RMSE | MAE | max | coverage of 95 % | us/step | to reach | |
|---|---|---|---|---|---|---|---|---|---|
| A, 25 degC | coulomb | right | 1.50 | 1.00 | 3.00 | 90 % | 1 |  |  |
| A, 25 degC | ekf | right | 0.40 | 0.30 | 1.00 | 99 % | 20 | RMSE <= 0.6 % | met |
| A, 25 degC | ukf | right | 0.41 | 0.30 | 1.00 | 99 % | 40 |  |  |
| A, 5 degC | coulomb | right | 1.60 | 1.00 | 3.00 | 90 % | 1 |  |  |
| A, 5 degC | ekf | right | 0.50 | 0.30 | 1.00 | 99 % | 20 | RMSE <= 0.6 % | met |
| B | coulomb | right | 1.70 | 1.00 | 3.00 | 90 % | 1 |  |  |
| B | ekf | right | 2.60 | 0.30 | 1.00 | 70 % | 20 | RMSE <= 2.0 % | **missed** |
"""


def load_script(name: str) -> ModuleType:
    """A script of the documentation, which is no package."""
    spec = spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    assert spec and spec.loader
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


fill_readme = load_script("fill_readme")


def test_it_has_programs_commands_and_links():
    assert len(programs(README)) == 2
    assert [words[0] for words in command_lines(README, "ohmward")] == [
        "demo",
        "doctor",
        "identify",
        "soc",
        "simulate",
        "slip",
        "mission",
        "mission",
        "mission",
        "export",
        "twin",
    ]
    assert "CONTRIBUTING.md" in links(README)


@pytest.mark.slow
def test_its_commands_can_be_pasted_one_after_the_other(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    day = make_robot_day("lfp")
    write_log(day.pulse_test, "test.csv")
    write_log(day.mission, "day.csv")
    for line in command_lines(README, "ohmward"):
        words, file = redirected(line)
        assert words[0] == "demo" or main(words) == 0, words
        printed = capsys.readouterr().out
        if file:
            (tmp_path / file).write_text(printed, encoding="utf-8")


def test_its_make_targets_exist():
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    wanted = re.findall(r"(?:^|`)make (\w+)", README.read_text(encoding="utf-8"), re.MULTILINE)
    assert set(wanted) >= {"demo", "test", "accuracy", "docs"}
    assert set(wanted) <= set(targets)


@pytest.mark.parametrize(
    "name, other, time", [("robot-day", "coulomb counting", "Time [h]"), ("drive-home", "driven wheels", "Time [s]")]
)
def test_its_pictures_are_whole(name, other, time):
    root = ElementTree.parse(ROOT / "docs" / "pictures" / f"{name}.svg").getroot()
    texts = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    assert {"truth", other, "ohmward", time} <= set(texts)
    assert len([e for e in root.iter() if "line" in e.get("class", "").split()]) >= 5
    assert f"docs/pictures/{name}.svg" in README.read_text(encoding="utf-8")


@pytest.mark.slow
def test_its_day_tells_the_truth():
    pictures = load_script("make_pictures")
    log, filtered, counted = pictures.robot_day()
    of_filter = score(filtered.soc, log.extra["soc_true"], filtered.soc_std)
    of_counting = score(counted.soc, log.extra["soc_true"])
    assert of_filter and of_counting
    assert of_filter.coverage_95 > 0.95
    assert 3 * of_filter.rmse < of_counting.rmse


@pytest.mark.slow
def test_its_drive_tells_the_truth():
    log, track = load_script("make_pictures").drive_home()
    truth, found = log.extra["speed_true_m_s"], track.estimates.speed_m_s
    wheels = RLMA.wheel.radius_m * track.estimates.wheel_speed_rad_s.mean(axis=1)
    rms = [float(np.sqrt(np.mean((v - truth) ** 2))) for v in (found, wheels)]
    assert 3 * rms[0] < rms[1]


def test_its_numbers_are_those_of_the_benchmark():
    text = README.read_text(encoding="utf-8")
    assert fill_readme.filled(text) == text, "run `python docs/fill_readme.py`"


def test_the_excerpt_shows_met_and_missed_goals_alike():
    lines = fill_readme.excerpt(list(fill_readme.read_rows(BENCHMARK)))
    assert lines[4:] == ["| A, 25 degC | right | 1.50 | 0.40 | 99 % |", "| B | right | 1.70 | 2.60 | 70 % |"]


def test_without_a_benchmark_there_is_no_excerpt(monkeypatch, tmp_path):
    monkeypatch.setattr(fill_readme, "ACCURACY", tmp_path / "absent.md")
    text = README.read_text(encoding="utf-8")
    emptied = fill_readme.filled(text)
    assert f"{fill_readme.BEGIN}{fill_readme.END}" in emptied
    assert fill_readme.filled(emptied) == emptied


def test_the_version_is_the_same_everywhere():
    import ohmward

    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"version: {ohmward.__version__}\n" in citation
    assert f"## {ohmward.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("word", ["revolutionary", "blazing", "seamless", "cutting-edge", "state-of-the-art"])
def test_it_does_not_boast(word):
    assert word not in README.read_text(encoding="utf-8").lower()
