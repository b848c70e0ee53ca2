"""The report of each command: one file, whole, with the sections that it is opened for."""

from html.parser import HTMLParser
from pathlib import Path

import pytest

from ohmward.cli.main import main
from ohmward.cli.wording import with_assumptions
from ohmward.report import Page

REPORTS = {
    "doctor": (
        ("doctor", "day.csv"),
        ("Current", "Voltage", "Temperature", "Time between samples", "What was assumed"),
    ),
    "two logs": (("doctor", "day.csv", "test.csv"), ("2 logs", "Current", "test")),
    "soc": (
        ("soc", "day.csv", "--battery", "battery.toml", "--truth", "soc_true"),
        ("State of charge", "Error of the state of charge", "Offset of the current sensor", "RMSE after 1 h"),
    ),
    "soc without truth": (("soc", "day.csv", "--battery", "battery.toml"), ("State of charge", "Voltage")),
    "coulomb": (("soc", "day.csv", "--battery", "battery.toml", "--filter", "coulomb"), ("State of charge",)),
    "compare": (
        ("compare", "day.csv", "--battery", "battery.toml", "--filters", "coulomb,ekf", "--truth", "soc_true"),
        ("estimators compared", "coulomb counting", "RMSE after 1 h"),
    ),
    "compare without truth": (
        ("compare", "day.csv", "--battery", "battery.toml", "--filters", "coulomb,ekf"),
        ("SoC difference, RMS",),
    ),
}


class Tags(HTMLParser):
    """Counts what is open, and what would be fetched."""

    def __init__(self):
        super().__init__()
        self.open, self.fetched = [], []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "link", "br", "img", "input", "hr"):
            self.open.append(tag)
        self.fetched += [value for name, value in attrs if name in ("src", "href") and not value.startswith("#")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.mark.parametrize("name", REPORTS)
def test_reports(name, here):
    words, parts = REPORTS[name]
    assert main([*words, "--report", "report.html"]) == 0
    text = Path("report.html").read_text(encoding="utf-8")
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    assert tags.fetched == []
    assert all(part in text for part in parts)
    assert len(text) < 600_000


def test_a_report_does_not_change_what_is_printed(here, capsys):
    words = ["doctor", "day.csv"]
    main(words)
    plain = capsys.readouterr().out
    main([*words, "--report", "report.html"])
    assert capsys.readouterr().out == plain


def test_reports_are_deterministic(here):
    main(["doctor", "day.csv", "--report", "a.html"])
    main(["doctor", "day.csv", "--report", "b.html"])
    assert Path("a.html").read_bytes() == Path("b.html").read_bytes()


def test_warnings_stand_out_among_the_assumptions():
    html = with_assumptions(Page("x"), ["info: plain", "warning: careful"]).html()
    assert "callout warning" in html
    assert "<td>plain</td>" in html
    assert "warning: careful" not in html
