"""What the documentation shows runs, what it links to exists, and every page can be found."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from markdown_pages import ROOT, anchors, command_lines, links, name_of, pages, programs, redirected
from ohmward import Battery, make_robot_day, save_battery, write_log
from ohmward.battery.chemistries import start_model, start_noise
from ohmward.cli.main import parse


@pytest.fixture(scope="module")
def workshop(tmp_path_factory):
    """A folder with the files that the pages speak of: a day and a battery."""
    folder = tmp_path_factory.mktemp("workshop")
    write_log(make_robot_day("lfp").mission.between(3000.0, 4200.0), folder / "day.csv")
    model, noise = start_model("lfp", 12.0, n_series=4), start_noise("lfp", 4)
    save_battery(Battery("robot", 12.0, "lfp", 4, thevenin=model, noise=noise), folder / "battery.toml")
    return folder


#: What holds at the end of the programs of a page, whose names are the attributes.
ENDS: dict[str, Callable[[Any], bool]] = {
    "README.md": lambda page: "<html" in Path("day.html").read_text(encoding="utf-8"),
    "docs/filters.md": lambda page: page.innovations.shape == (1000,) and page.state.noise.samples == 1,
    "docs/odometry.md": lambda page: page.pose.flags == 0 and page.calibrated.settings.noise.radius_std == 0.003,
    "docs/trace.md": lambda page: page.voltage_V.shape == (1000,) and page.voltages_V.shape == (1000, 64),
    "docs/traction-models.md": lambda page: 0.4 < page.x[0] < 0.6 and 0.0 < page.slip_J < page.copper_J,
}


@pytest.mark.parametrize("page", [p for p in pages() if programs(p)], ids=name_of)
def test_the_programs_of_a_page_run_from_top_to_bottom(page, workshop, monkeypatch):
    monkeypatch.chdir(workshop)
    names: dict[str, object] = {}
    for program in programs(page):
        exec(compile(program, name_of(page), "exec"), names)
    assert name_of(page) not in ENDS or ENDS[name_of(page)](SimpleNamespace(**names))


@pytest.mark.parametrize("page", [p for p in pages() if list(command_lines(p, "ohmward"))], ids=name_of)
def test_the_command_lines_of_a_page_are_understood(page):
    for words in command_lines(page, "ohmward"):
        if words not in (["--help"], ["--version"]):
            parse(redirected(words)[0])


def test_links_lead_somewhere():
    for page in pages():
        for link in links(page):
            path, _, anchor = link.partition("#")
            target = (page.parent / path).resolve() if path else page
            assert target.exists(), f"{name_of(page)} links to {link}, which does not exist"
            if anchor:
                assert anchor in anchors(target), f"{name_of(page)} links to {link}, but there is no such heading"


def test_an_included_page_brings_no_title_of_its_own():
    """The navigation would show both."""
    for page in pages():
        for block in re.findall(r"```\{include\} (\S+)\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            if not block[1]:
                included = (page.parent / block[0]).read_text(encoding="utf-8")
                assert not included.startswith("# "), f"{name_of(page)} includes {block[0]} with its title"


def test_pages_name_no_path_of_this_machine():
    assert [name_of(page) for page in pages() if str(ROOT) in page.read_text(encoding="utf-8")] == []


def test_every_page_can_be_found_from_the_index():
    docs = ROOT / "docs"
    found, waiting = set(), [docs / "index.md"]
    while waiting:
        page = waiting.pop()
        if page not in found:
            found.add(page)
            waiting += children(page)
    assert {name_of(p) for p in pages() if docs in p.parents} == {name_of(p) for p in found}, "add it to docs/index.md"


@pytest.mark.slow
def test_the_documentation_builds_without_a_warning_and_reads_without_a_network(tmp_path):
    for needed in ("sphinx", "myst_nb", "sphinx_design", "furo"):
        pytest.importorskip(needed, reason="pip install --group docs to build the documentation")
    # the notebooks run in a test of their own
    options = ["-W", "-q", "-t", "quick", "-D", "nb_execution_mode=off", "-b", "html"]
    built = [sys.executable, "-m", "sphinx", *options, ROOT / "docs", tmp_path]
    assert subprocess.run(built, capture_output=True, text=True, check=False).stderr == ""
    for page in tmp_path.rglob("*.html"):
        assert re.findall(r"<(?:script|link|img)[^>]*https?://[^>]*>", page.read_text(encoding="utf-8")) == []
    assert "<math" in (tmp_path / "theory" / "rc-model.html").read_text(encoding="utf-8")
    filters = (tmp_path / "reference" / "filters.html").read_text(encoding="utf-8")
    assert 'id="ohmward.filters.kalman.predict"' in filters


def children(page: Path) -> list[Path]:
    tables = re.findall(r"^```\{toctree\}\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    names = [line.strip() for table in tables for line in table.splitlines() if line.strip() and line[0] != ":"]
    return [page.parent / f"{name}.md" for name in names]
