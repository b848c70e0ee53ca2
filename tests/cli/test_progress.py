import sys
from contextlib import nullcontext

import pytest

from ohmward.cli import soc
from ohmward.cli.main import main
from ohmward.cli.outcome import counting, progress


def test_nobody_watches():
    with progress() as report:
        assert report is None


def test_a_bar_on_a_terminal_leaves_standard_output_alone(here, capsys, monkeypatch):
    words = ["soc", "day.csv", "--battery", "battery.toml", "-o", "e.csv", "--json"]
    main(words)
    plain = capsys.readouterr().out
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    main(words)
    out, err = capsys.readouterr()
    assert out.splitlines()[:5] == plain.splitlines()[:5]
    assert "writing e.csv" in err


def test_without_rich_there_is_no_bar(monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setitem(sys.modules, "rich", None)
    with progress() as report:
        assert report is None


def test_a_bar_is_drawn_from_shares(monkeypatch):
    pytest.importorskip("rich")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress() as report:
        assert report is not None
        report("circuit", 0.5)


def test_every_stage_is_told_from_its_beginning_to_its_end(here, monkeypatch):
    told: list[tuple[str, float]] = []
    monkeypatch.setattr(soc, "progress", lambda: nullcontext(lambda what, share: told.append((what, share))))
    main(["soc", "day.csv", "--battery", "battery.toml", "-o", "e.csv"])
    stages = list(dict.fromkeys(what for what, _ in told))
    assert stages == ["reading day.csv", "gsf", "writing e.csv"]
    for stage in stages:
        shares = [share for what, share in told if what == stage]
        assert (shares[0], shares[-1]) == (0.0, 1.0)
        assert shares == sorted(shares)


def test_counts_become_shares_if_somebody_watches():
    told: list[tuple[str, float]] = []
    count = counting(lambda what, share: told.append((what, share)), "reading")
    assert count is not None and told == [("reading", 0.0)]
    count(5, 20)
    assert told[-1] == ("reading", 0.25)
    assert counting(None, "reading") is None
