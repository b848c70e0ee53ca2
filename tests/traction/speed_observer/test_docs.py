import re
from pathlib import Path

PAGE = Path(__file__).parents[3] / "docs" / "traction-observers.md"


def test_the_page_runs():
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    exec(block, {})
