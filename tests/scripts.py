"""The benchmarks and the scripts of documentation and firmware, which are no packages."""

import sys
from importlib import import_module
from types import ModuleType

from markdown_pages import ROOT


def script(name: str, folder: str = "benchmarks") -> ModuleType:
    """A module of benchmarks/, docs/ or firmware/."""
    if str(ROOT / folder) not in sys.path:
        sys.path.insert(0, str(ROOT / folder))
    return import_module(name)
