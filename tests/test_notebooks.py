"""The notebooks run from the first cell to the last, on the recordings that ship, and show what they are about."""

import tomllib

import matplotlib
import pytest

from notebooks import FOLDER, notebooks, run_notebook, skip_without_compiler
from ohmward_lab.examples import FOLDER as RECORDINGS

matplotlib.use("Agg")


def test_there_are_ten_and_their_recordings_take_a_megabyte():
    assert len(notebooks()) == 10
    assert sum(path.stat().st_size for path in RECORDINGS.rglob("*") if path.is_file()) <= 1_000_000


@pytest.mark.parametrize("notebook", notebooks(), ids=lambda path: path.stem)
def test_it_runs(notebook, tmp_path, monkeypatch):
    skip_without_compiler(notebook)
    monkeypatch.chdir(tmp_path)
    shown, picture = run_notebook(notebook)
    assert picture is not None, "tag the cell whose picture the gallery shows with `thumbnail`"
    pages = [value._repr_html_() for value in shown if hasattr(value, "_repr_html_")]
    assert all(page is None or "<" in page for page in pages)  # matplotlib's figures have none but with a widget


def test_the_gallery_has_each_of_them():
    gallery = (FOLDER.parent / "gallery.md").read_text(encoding="utf-8")
    for notebook in notebooks():
        assert f"notebooks/{notebook.stem}" in gallery
        assert (FOLDER.parent / "pictures" / "gallery" / f"{notebook.stem}.png").exists()


def test_the_gallery_names_the_packages_with_which_the_documentation_is_built():
    project = tomllib.loads((FOLDER.parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["dependency-groups"]["docs"][0].removeprefix("ohmward")
    assert f"pip install '.{extras}'" in (FOLDER.parent / "gallery.md").read_text(encoding="utf-8")
