import pytest

from markdown_pages import ROOT, programs

PAGE = ROOT / "docs" / "logs.md"


def test_the_first_example_prints_what_the_page_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    pytest.importorskip("pandas")
    exec(programs(PAGE)[0], {})
    assert capsys.readouterr().out == programs(PAGE, "text")[0]
