"""What was assumed: all of it in a file and with -v, its warnings and number at a terminal, its warnings with -q."""

import sys

import pytest

from ohmward.cli.main import main

SOC = ("soc", "day.csv", "--battery", "battery.toml", "--sensor-offset", "0.2")
WARNING = "--sensor-offset 0.2 A was used"


@pytest.fixture
def terminal(here, monkeypatch, capsys):
    """What a command prints at a terminal of so many columns."""

    def run(*words: str, columns: int = 60, colour: bool = False) -> str:
        monkeypatch.setenv("COLUMNS", str(columns))
        monkeypatch.setenv("NO_COLOR", "" if colour else "1")
        monkeypatch.setenv("TERM", "xterm")
        with monkeypatch.context() as patch:
            patch.setattr(sys.stdout, "isatty", lambda: True)
            assert main(list(words)) == 0
        return capsys.readouterr().out

    return run


def test_a_file_gets_everything(here, capsys):
    assert main(list(SOC)) == 0
    out = capsys.readouterr().out
    assert "\nAssumed:\n" in out and "current from 'current_A' in A" in out and f"warning: {WARNING}" in out


def test_a_terminal_gets_the_answer_and_the_warnings(terminal):
    out = terminal(*SOC)
    assert "current from" not in out and "-v\nlists them." in out
    assert f"\nWarnings:\n  - {WARNING}" in out
    paragraphs = out.split("\n\n")
    assert max(len(line) for paragraph in paragraphs[-2:] for line in paragraph.splitlines()) <= 60


def test_everything_on_demand(terminal):
    assert "current from 'current_A' in A" in terminal(*SOC, "-v")


def test_the_answer_alone(terminal):
    out = terminal(*SOC, "-q")
    assert WARNING in out and "Assumed" not in out and "current from" not in out


def test_the_doctor_says_what_it_took_for_what(terminal):
    assert "current from 'current_A' in A" in terminal("doctor", "day.csv")


def test_a_terminal_emphasises_the_answer_and_the_warnings(terminal):
    out = terminal(*SOC, colour=True)
    assert out.split("\n\n")[1].startswith("\x1b[1mSoC ") and "\x1b[1;33mWarnings:\x1b[0m" in out
    assert "\x1b" not in terminal(*SOC)


def test_a_terminal_shows_errors_in_red(monkeypatch, capsys):
    monkeypatch.setenv("NO_COLOR", "")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert main(["soc", "no-such-log.csv", "--battery", "battery.toml"]) == 2
    assert "\x1b[1;31mohmward: error:\x1b[0m " in capsys.readouterr().err
