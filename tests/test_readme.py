"""The front page keeps its promises: its commands exist, its numbers come from the benchmark, its picture is whole."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from markdown_pages import ROOT, command_lines, links, programs, redirected
from ohmward import make_robot_day, score, write_log
from ohmward.cli.main import main
from scripts import script

README = ROOT / "README.md"


fill_readme = script("fill_readme", "docs")


def test_it_has_a_program_commands_and_links():
    assert len(programs(README)) == 1
    assert [words[0] for words in command_lines(README, "ohmward")] == [
        "demo",
        "run",
        "doctor",
        "identify",
        "learn",
        "soc",
        "simulate",
        "slip",
        "mission",
        "export",
    ]
    assert "CONTRIBUTING.md" in links(README)


@pytest.mark.slow
def test_its_commands_can_be_pasted_one_after_the_other(tmp_path, short_drives, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    day = make_robot_day("lfp")
    write_log(day.pulse_test, "test.csv")
    write_log(day.mission, "day.csv")
    for line in command_lines(README, "ohmward"):
        words, file = redirected(line)
        if words[0] == "demo" or words == ["run", "--demo"]:
            continue  # tests of their own run them: one takes a minute, one does not end
        assert main(words) == 0, words
        printed = capsys.readouterr().out
        if file:
            (tmp_path / file).write_text(printed, encoding="utf-8")


def test_its_make_targets_exist():
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    wanted = re.findall(r"(?:^|`)make (\w+)", README.read_text(encoding="utf-8"), re.MULTILINE)
    assert set(wanted) >= {"demo", "check", "test", "accuracy", "bench", "docs"}
    assert set(wanted) <= set(targets)


@pytest.mark.parametrize(
    "name, texts",
    [
        ("robot-day", {"coulomb counting", "its 95 % band", "Time [h]"}),
        ("drive-home", {"driven wheels", "its 95 % band", "Time [s]"}),
        ("range-left", {"P10 to P90", "Distance driven [km]"}),
    ],
)
def test_its_pictures_are_whole(name, texts):
    root = ElementTree.parse(ROOT / "docs" / "pictures" / f"{name}.svg").getroot()
    found = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    assert {"truth", "ohmward", *texts} <= set(found)
    assert len([e for e in root.iter() if "line" in e.get("class", "").split()]) >= 2
    assert f"docs/pictures/{name}.svg" in README.read_text(encoding="utf-8")


@pytest.mark.slow
def test_its_day_tells_the_truth():
    pictures = script("make_pictures", "docs")
    log, filtered, counted = pictures.robot_day()
    of_filter = score(filtered.soc, log.extra["soc_true"], filtered.soc_std)
    of_counting = score(counted.soc, log.extra["soc_true"])
    assert of_filter and of_counting
    assert of_filter.coverage_95 > 0.95
    assert 2.5 * of_filter.rmse < of_counting.rmse


@pytest.mark.parametrize("path", [README, fill_readme.PAPER, fill_readme.ENERGY], ids=lambda path: path.name)
def test_its_numbers_are_those_of_the_benchmark(path):
    assert fill_readme.filled(path) == path.read_text(encoding="utf-8"), "run `python docs/fill_readme.py`"


def test_its_tables_have_five_rows_each():
    text = README.read_text(encoding="utf-8")
    for name in ("accuracy", "speed"):
        block = text.partition(f"<!-- {name}:")[2].partition(f"<!-- /{name} -->")[0]
        assert len([line for line in block.splitlines() if line.startswith("|")]) == 2 + 5


def test_without_a_benchmark_there_is_no_table(monkeypatch, tmp_path):
    monkeypatch.setattr(fill_readme, "BENCHMARKS", tmp_path)
    emptied = fill_readme.filled(README)
    assert "<!-- accuracy: written by docs/fill_readme.py -->\n<!-- /accuracy -->" in emptied


@pytest.mark.slow
def test_its_range_holds_the_truth():
    day = script("make_pictures", "docs").range_of_a_day(asked_every_s=900)
    inside = (day.p10_m <= day.truth_m) & (day.truth_m <= day.p90_m)
    assert 0.5 <= inside.mean() <= 1.0
    assert np.abs(day.p50_m - day.truth_m).max() < 0.15 * day.truth_m[0]


def test_the_version_is_the_same_everywhere():
    import ohmward

    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"version: {ohmward.__version__}\n" in citation
    assert f"## {ohmward.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("word", ["revolutionary", "blazing", "seamless", "cutting-edge", "state-of-the-art"])
def test_it_does_not_boast(word):
    assert word not in README.read_text(encoding="utf-8").lower()
