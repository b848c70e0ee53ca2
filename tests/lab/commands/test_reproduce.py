import pytest

from ohmward.cli.main import main
from ohmward_lab.reproduce.errata import ERRATA


def test_the_errata_all_hold(as_json):
    found = as_json("reproduce", "errata")["errata"]
    assert len(found) == len(ERRATA)
    assert all(row["holds"] for row in found)
    assert set(found[0]) == {"text", "place", "printed", "correct", "holds"}


def test_one_figure_as_rows_and_page(as_json, tmp_path, capsys):
    page = tmp_path / "page.html"
    found = as_json("reproduce", "paper", "--only", "5", "--report", str(page))
    assert {row["item"] for row in found["rows"]} == {"5, 6"}
    assert set(found["rows"][0]) == {"item", "quantity", "unit", "printed", "as_printed", "corrected", "default", "why"}
    text = page.read_text(encoding="utf-8")
    assert "Errors in the text" in text and "two time constants" in text
    assert main(["reproduce", "paper", "--only", "6"]) == 0
    assert "Why they differ" in capsys.readouterr().out


def test_the_filters_of_the_thesis_along_a_log_of_ones_own(here, as_json):
    found = as_json(
        "reproduce",
        "thesis",
        "--only",
        "measured",
        "--log",
        "day.csv",
        "--battery",
        "battery.toml",
        "--initial-soc",
        "0.9",
    )
    rows = {row["quantity"]: row for row in found["rows"]}
    assert len(rows) == 16 and {row["item"] for row in found["rows"]} == {"measured"}
    assert rows["Voltage before the sample, EKF: mean"]["corrected"] < 0.05
    assert rows["SoC, AUKF: largest"]["default"] < 10.0


@pytest.mark.parametrize(
    "words, message",
    [
        (("thesis", "--only", "9.9"), "--only must be one of"),
        (("errata", "--only", "3.2"), "the errata are checked together"),
        (("paper", "--log", "day.csv"), "the filters of the thesis"),
        (("thesis", "--log", "day.csv"), "--log needs --battery"),
        (("thesis", "--data", "nowhere"), "--data must name the folder that holds tue_cells"),
        (("paper", "--data", "nowhere"), "--data adds a cell to the thesis"),
        (("book",), "invalid choice"),
    ],
)
def test_what_is_not_there_is_refused(words, message, refused):
    assert message in refused("reproduce", *words)
