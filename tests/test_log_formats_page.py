"""The tables of formats in docs/logs.md are those of the formats that the tests read."""

from scripts import script

fill_formats = script("fill_formats", "docs")


def test_the_page_lists_the_formats_of_the_tests():
    text = fill_formats.PAGE.read_text(encoding="utf-8")
    assert fill_formats.filled(text) == text, "run `python docs/fill_formats.py`"
    named = [about.name for about in fill_formats.FORMATS if about.flags or about.family not in fill_formats.NOTATIONS]
    assert named
    assert [name for name in named if name.partition(", ")[0] not in text] == []
