"""The examples of docs/theory/rc-model.md run from top to bottom."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[3] / "docs" / "theory" / "rc-model.md"


def test_the_page_runs_from_top_to_bottom(capsys):
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(blocks) == 2
    exec("\n".join(blocks), {})
    assert "too slow for the first 500 ms" in capsys.readouterr().out
