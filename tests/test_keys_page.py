"""The page of keys is that of the records, and each key has a meaning."""

import re

from scripts import script

fill_keys = script("fill_keys", "docs")


def test_the_page_is_that_of_the_records():
    assert fill_keys.PAGE.read_text(encoding="utf-8") == fill_keys.page(), "run `python docs/fill_keys.py`"


def test_every_key_has_a_meaning():
    assert re.findall(r"^- `(\w+)`.*: *$", fill_keys.page(), re.MULTILINE) == []
