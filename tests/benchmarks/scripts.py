"""The benchmarks, which are scripts and no package."""

import sys
from importlib import import_module
from types import ModuleType

from markdown_pages import ROOT


def script(name: str) -> ModuleType:
    """A module of benchmarks/."""
    folder = str(ROOT / "benchmarks")
    if folder not in sys.path:
        sys.path.insert(0, folder)
    return import_module(name)
