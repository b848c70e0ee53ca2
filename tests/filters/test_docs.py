import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "filters.md"


def test_the_page_runs_from_top_to_bottom():
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(blocks) == 3
    names: dict = {}
    exec("\n".join(blocks), names)
    assert names["innovations"].shape == (1000,)
    assert names["state"].noise.samples == 1
