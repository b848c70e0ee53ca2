"""What some tests need besides Python's packages: a compiler, a browser, measured data; without it they are skipped."""

import os
import shutil
from pathlib import Path

import pytest

from markdown_pages import ROOT

#: Folder of the measured data.
DATA = Path(os.environ.get("OHMWARD_DATA", ROOT.parent / "shared" / "data"))
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")

needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="no C compiler here: gcc is not installed")
needs_cppcheck = pytest.mark.skipif(not shutil.which("cppcheck"), reason="cppcheck is not installed")


def measured_file(name: str) -> Path:
    """The path of a measured file or folder."""
    path = DATA / name
    if not path.exists():
        pytest.skip(f"measured data not found: {path} (set OHMWARD_DATA to the folder that holds it)")
    return path
