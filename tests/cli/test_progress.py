import sys

import pytest

from ohmward.cli.main import main
from ohmward.cli.progress import progress


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
    assert "ekf" in err


def test_without_rich_there_is_no_bar(monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setitem(sys.modules, "rich.console", None)
    with progress() as report:
        assert report is None


def test_a_bar_is_drawn_from_shares(monkeypatch):
    pytest.importorskip("rich")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress() as report:
        assert report is not None
        report("circuit", 0.5)
