"""The page on the band: its table of priors is that of the code."""

from scripts import script

fill_how_sure = script("fill_how_sure", "docs")


def test_priors_on_the_page_are_those_of_the_code():
    text = fill_how_sure.PAGE.read_text(encoding="utf-8")
    assert fill_how_sure.described(text) == text, "run `python docs/fill_how_sure.py`"


def test_every_prior_has_a_meaning():
    names = ", ".join(fill_how_sure.attributes(fill_how_sure.ChemistryPrior))
    assert [name for name in fill_how_sure.ChemistryPrior._fields if name not in names] == []


def test_each_prior_has_its_own_meaning_and_not_that_of_a_longer_name():
    meanings = [row.split("|")[2] for row in fill_how_sure.prior_table()[2:]]
    shared = ("pair_activation_K", "tau_activation_K")
    assert len(set(meanings)) >= len(meanings) - len(shared) + 1
