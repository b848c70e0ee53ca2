"""Make the pictures of the gallery: run every notebook and keep what its cell with the tag `thumbnail` shows."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import matplotlib

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from notebooks import notebooks, run_notebook

PICTURES = Path(__file__).parent / "pictures" / "gallery"
WIDTH_IN, HEIGHT_IN, DPI = 5.0, 2.8, 100


def main() -> None:
    """Write a picture for each notebook."""
    matplotlib.use("Agg")
    PICTURES.mkdir(exist_ok=True)
    for notebook in notebooks():
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            _, picture = run_notebook(notebook)
        figure = first_axes(picture)
        figure.savefig(PICTURES / f"{notebook.stem}.png", dpi=DPI, bbox_inches="tight", pil_kwargs={"optimize": True})
        print(notebook.stem)


def first_axes(picture: Any) -> Any:
    """The picture as a figure of matplotlib of the size of a card, of several axes the first."""
    figure = picture.to_matplotlib() if hasattr(picture, "to_matplotlib") else picture
    first, *others = figure.axes
    for axes in others:
        axes.remove()
    figure.set_size_inches(WIDTH_IN, HEIGHT_IN)
    if others:
        figure.set_layout_engine("none")
        first.set_position((0.1, 0.12, 0.87, 0.76))
        first.tick_params(labelbottom=True)
    return figure


if __name__ == "__main__":
    main()
