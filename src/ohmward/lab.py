"""Modules of the laboratory, the package `ohmward_lab`, which are loaded by name by who asks for them."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


def lab(module: str) -> ModuleType:
    """The module of that name below `ohmward_lab`."""
    return import_module(f"ohmward_lab.{module}")
