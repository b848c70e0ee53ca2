"""`ohmward assess` as typed: table, page and JSON, and a wrong word."""

from ohmward.cli.main import main
from ohmward_lab.assess.study import STUDIES

ONLY = ["--only", "nca", "--only", "base", "--only", "coulomb", "--only", "textbook-ekf", "--runs", "2"]


def test_table_page_and_json(as_json, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    found = as_json("assess", *ONLY, "--processes", "1", "--report", "limits.html")
    assert [cell["method"] for cell in found["cells"]] == ["coulomb", "textbook-ekf"]
    assert all(cell["rmse"] > 0.0 for cell in found["cells"]) and found["recommended"]
    page = (tmp_path / "limits.html").read_text(encoding="utf-8")
    assert "Recommendation" in page and 'class="number heat-' in page
    assert main(["assess", *ONLY]) == 0  # goes on where all is done
    text = capsys.readouterr().out
    assert (
        "base: everyday sensors" in text and "16 KB of flash" in text and "ohmward-assess/battery/summary.csv" in text
    )


def test_the_study_of_traction(as_json, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["assess", "traction", "--only", "rlma", "--only", "base", "--only", "wheels", "--only", "ekf"]
    found = as_json(*words, "--runs", "2", "--report", "limits.html")
    assert [cell["method"] for cell in found["cells"]] == ["wheels", "ekf"] and found["study"] == "traction"
    assert found["cells"][0]["speed_covered"] is None and found["cells"][1]["slip_covered"] > 0.9
    page = (tmp_path / "limits.html").read_text(encoding="utf-8")
    assert "RMSE of the slip ratio" in page and 'class="number heat-' in page
    assert main([*words, "--runs", "2"]) == 0
    text = capsys.readouterr().out
    assert "cm/s" in text and "64 KB of flash" in text and "ohmward-assess/traction/summary.csv" in text


def test_what_is_not_recommended_is_said_in_text_page_and_json(as_json, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["assess", "traction", "--only", "rlma", "--only", "slope", "--only", "wheels", "--only", "ekf"]
    words += ["--runs", "2", "--largest-error", "0.01"]
    found = as_json(*words, "--report", "limits.html")
    assert {row["method"] for row in found["recommended"]} == {None}
    (sentence,) = found["worse"]
    assert sentence.startswith("rlma, slopes: every filter is worse than wheels (")
    assert main(words) == 0
    for text in (capsys.readouterr().out, (tmp_path / "limits.html").read_text(encoding="utf-8")):
        assert sentence in text and found["rule"] in text and "none; no row of this table helps" in text


def test_a_study_that_there_is_not_is_answered_by_all(capsys):
    assert main(["assess", "range"]) == 2
    assert f"choose from {', '.join(map(repr, STUDIES))}" in capsys.readouterr().err


def test_a_word_that_names_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["assess", "--only", "nickel"]) == 2
    assert "there is no 'nickel' to assess; there are lfp" in capsys.readouterr().err
    assert not (tmp_path / "ohmward-assess").exists()
