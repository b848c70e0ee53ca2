"""Modules of the laboratory, the package `ohmward_lab`, loaded by name on request."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


def lab(module: str) -> ModuleType:
    """Import a module of `ohmward_lab` by its name."""
    return import_module(f"ohmward_lab.{module}")
