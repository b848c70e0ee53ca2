"""Sphinx: `make docs` runs the notebooks and builds docs/_build/html; neither needs a network."""

from __future__ import annotations

import gc
import os
import sys
from pathlib import Path

import ohmward

sys.path.insert(0, str(Path(__file__).parent / "extensions"))
# Pages are many objects that live long; at the usual threshold the collector takes a quarter of the time.
gc.set_threshold(100_000, 20, 20)

project = "ohmward"
author = "the ohmward authors"
copyright = "the ohmward authors, Apache License 2.0"
version = release = ohmward.__version__

extensions = [
    "myst_nb",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx.ext.autodoc",
    "accessible",
    "listed_names",
    "offline_math",
    "plain_docstrings",
]
# `-t quick` leaves out what takes most of the time and warns of nothing: copies of the source, every function in the
# contents of every page, links from types, and defaults as they are written.
if not tags.has("quick"):  # noqa: F821 (Sphinx gives it)
    extensions.append("sphinx.ext.viewcode")
toc_object_entries = not tags.has("quick")  # noqa: F821
exclude_patterns = ["_build", "extensions"]
# Notebooks call `ohmward` of this environment, write into a folder of their own, and end the build where they fail.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True

suppress_warnings = [
    "ref.python",
    "myst-nb.lexer",
]  # rooms may each have an `Input`; a page that does not run has no kernel

myst_enable_extensions = ["dollarmath", "deflist", "attrs_block", "colon_fence"]
myst_heading_anchors = 3
myst_dmath_double_inline = True

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "none" if tags.has("quick") else "signature"  # noqa: F821
autodoc_typehints_format = "short"
autodoc_preserve_defaults = not tags.has("quick")  # noqa: F821
autodoc_use_type_comments = False  # the types are annotations

html_theme = "furo"
html_title = f"ohmward {version}"
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
