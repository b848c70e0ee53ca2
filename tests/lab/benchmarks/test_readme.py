"""The list of the benchmarks names every script and every page, and nothing that is not there."""

import re

from markdown_pages import ROOT

FOLDER = ROOT / "benchmarks"


def test_every_script_and_page_is_listed_and_there():
    named = set(re.findall(r"`(\w+\.(?:py|md))`", (FOLDER / "README.md").read_text(encoding="utf-8")))
    there = {path.name for path in FOLDER.iterdir() if path.suffix in (".py", ".md")} - {"README.md"}
    assert named == there
