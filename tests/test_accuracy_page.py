"""The accuracy page: what runs, what is written when data are absent, and what the README takes from it."""

import sys
from collections.abc import Iterator

import pytest

from scripts import script

accuracy, figure = script("accuracy"), script("figure")

RUN = figure.at_most("sand", "brush", "RMSE [N]", 1.5, 2.0)
SLOW = figure.at_least("car", "ekf", "coverage", 0.5, 0.9)
PLAIN = figure.at_most("car", "ekf", "RMSE [m/s]", 0.1)


def parts(*rows: object) -> dict:
    def here() -> Iterator:
        yield from rows

    return {"here": here}


def absent() -> Iterator:
    yield PLAIN
    raise FileNotFoundError("folder/file.csv")


@pytest.fixture
def page_file(monkeypatch, tmp_path):
    page = tmp_path / "accuracy.md"
    page.write_text("before")
    monkeypatch.setattr(accuracy, "PAGE", page)
    monkeypatch.setattr(accuracy, "KEPT", tmp_path / "kept")
    return page


def run(monkeypatch, found, *names):
    monkeypatch.setattr(accuracy, "all_parts", lambda: found)
    monkeypatch.setattr(sys, "argv", ["accuracy.py", *names])
    return accuracy.main()


def test_it_writes_what_was_met_and_missed(monkeypatch, page_file, capsys):
    assert run(monkeypatch, parts(RUN, SLOW)) == 0
    text = page_file.read_text()
    assert "| sand | brush | RMSE [N] | 1.5 | <= 2 | met |" in text
    assert "| car | ekf | coverage | 0.5 | >= 0.9 | **missed** |" in text
    assert "2 rows, 1 bars met, 1 missed" in capsys.readouterr().out


def test_the_page_is_written_where_every_part_has_rows(monkeypatch, page_file, capsys):
    assert run(monkeypatch, parts(RUN) | {"absent": absent}) == 0
    said = capsys.readouterr().err
    assert "absent: folder/file.csv is absent (set OHMWARD_DATA" in said
    assert "accuracy.md is unchanged: no rows yet of absent" in said
    assert page_file.read_text() == "before"
    assert run(monkeypatch, parts(RUN) | {"absent": lambda: iter([PLAIN])}, "absent") == 0
    text = page_file.read_text()
    assert "| sand | brush |" in text and "| car | ekf |" in text


def test_an_unknown_part_is_refused_with_those_that_exist(monkeypatch, page_file, capsys):
    assert run(monkeypatch, parts(RUN), "nowhere") == 2
    assert "no part nowhere; there are here" in capsys.readouterr().err


def test_the_battery_and_the_robot_have_parts():
    assert {"a123", "panasonic", "inr20r", "vrla", "ornl", *accuracy.TRACTION} == set(accuracy.all_parts())
