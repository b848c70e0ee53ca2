import re
from pathlib import Path

import numpy as np

PAGE = Path(__file__).parents[2] / "docs" / "trace.md"


def test_the_page_runs_from_top_to_bottom():
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(blocks) == 2
    names: dict = {}
    exec("\n".join(blocks), names)
    assert names["voltage_V"].shape == (1000,)
    assert names["voltages_V"].shape == (1000, 64)
    np.testing.assert_allclose(names["J"], [[1.0, 0.1], [2.0 / np.cosh(0.5) ** 2, np.tanh(0.5)]], rtol=1e-14)
