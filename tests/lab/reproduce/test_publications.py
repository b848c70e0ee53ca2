import pytest

from ohmward.errors import InputError
from ohmward_lab.reproduce.publications import PUBLICATIONS, select
from scripts import script

fill = script("fill_publications", "docs")
THESIS = PUBLICATIONS["thesis"]


def test_every_number_of_a_publication_is_there_once():
    for publication in PUBLICATIONS.values():
        numbers = [number for item in publication.items for number in item.numbers]
        assert len(set(numbers)) == len(numbers)


def test_all_results_of_chapter_3_are_there():
    numbers = {number for item in THESIS.items for number in item.numbers}
    assert numbers >= {"3.1", "3.2", "3.3", *(f"3.{k}" for k in range(6, 16))}
    assert numbers >= {"5.6", "5.7", "5.8", "5.9"}


def test_a_figure_selects_its_item_once():
    (item,) = select(THESIS, ["3.2", "3.11"])
    assert "3.12" in item.numbers


def test_an_unknown_number_is_refused_with_those_there_are():
    with pytest.raises(InputError, match=r"--only must be one of 3\.1, .* got '9.9'"):
        select(THESIS, ["9.9"])


def test_the_claims_and_the_errata_of_the_pages_are_those_of_the_tables():
    numbers = fill.NUMBERS.read_text(encoding="utf-8")
    for short, page in fill.PAGES.items():
        text = page.read_text(encoding="utf-8")
        assert fill.filled(text, short, numbers) == text, "run `python docs/fill_publications.py`"
    text = fill.ERRATA_PAGE.read_text(encoding="utf-8")
    assert fill.with_errata(text) == text, "run `python docs/fill_publications.py`"
