import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "logs.md"


def test_the_examples_of_the_page_run_and_print_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    pytest.importorskip("pandas")
    text = PAGE.read_text(encoding="utf-8")
    examples = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict[str, object] = {}
    exec(examples[0], names)
    assert capsys.readouterr().out == re.findall(r"```text\n(.*?)```", text, re.DOTALL)[0]
    for example in examples[1:]:
        exec(example, names)
    assert len(examples) == 4
