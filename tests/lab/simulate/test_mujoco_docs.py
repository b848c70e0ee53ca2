import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[3] / "docs" / "mujoco-plant.md"


def test_the_examples_of_the_page_run():
    pytest.importorskip("mujoco", reason="the plant needs MuJoCo: pip install mujoco")
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(blocks) == 2
    exec("\n".join(blocks), {})
