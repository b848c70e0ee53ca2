"""Sphinx: `make docs` builds docs/_build/html, which needs no network, neither to build nor to read."""

from __future__ import annotations

import sys
from pathlib import Path

import ohmward

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "ohmward"
author = "the ohmward authors"
copyright = "the ohmward authors, Apache License 2.0"
version = release = ohmward.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "offline_math",
    "plain_docstrings",
]
exclude_patterns = ["_build", "extensions"]
suppress_warnings = ["ref.python"]  # rooms may each have their own `Input`

myst_enable_extensions = ["dollarmath", "deflist", "attrs_block"]
myst_heading_anchors = 3
myst_dmath_double_inline = True

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True

html_theme = "furo"
html_title = f"ohmward {version}"
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
