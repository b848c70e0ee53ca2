import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "traction-models.md"


def test_the_page_runs():
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    names: dict = {}
    exec(block, names)
    assert 0.4 < names["x"][0] < 0.6
    assert 0.0 < names["slip_J"] < names["copper_J"]
