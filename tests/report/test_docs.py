"""The examples of docs/report.md run as they stand."""

import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs" / "report.md"


def test_the_examples_of_the_documentation_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for example in re.findall(r"```python\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL):
        exec(compile(example, str(DOCS), "exec"), names)
    assert {p.name for p in tmp_path.iterdir()} == {"report.html"}
