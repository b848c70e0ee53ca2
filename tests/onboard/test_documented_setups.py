"""Every setup that the documentation shows is one that `ohmward run` takes."""

import re

import pytest

from markdown_pages import ROOT
from ohmward.onboard.robot_setup import SETUP_FILE

SETUPS = [
    (page.name, text)
    for page in sorted((ROOT / "docs").glob("*.md"))
    for text in re.findall(r"^```toml\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    if "ohmward-setup/1" in text
]


@pytest.mark.parametrize(("page", "text"), SETUPS, ids=[page for page, _ in SETUPS])
def test_a_setup_of_a_page_is_taken(page, text):
    setup = SETUP_FILE.parse(text)
    assert setup.source or setup.sink


def test_pages_show_setups():
    assert {"can.md", "drive.md", "microcontroller.md", "mqtt.md"} <= {page for page, _ in SETUPS}
