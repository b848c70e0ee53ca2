"""Lists of modules and names in the pages of the reference, a line each, as headings and autodoc directives.

A fenced block `{modules}` lists modules; those of `ohmward` without its name. `{names}` lists names of `ohmward`;
options behind it are those of every directive.
"""

from __future__ import annotations

import re

from sphinx.application import Sphinx

import ohmward

BLOCK = re.compile(r"^```\{(modules|names)\} *([^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def setup(app: Sphinx) -> dict[str, bool]:
    """Listen to the reading of pages."""
    app.connect("source-read", expand)
    return {"parallel_read_safe": True}


def expand(app: Sphinx, page: str, source: list[str]) -> None:
    """Write the lists out, in place, as the event asks for."""
    source[0] = BLOCK.sub(_directives, source[0])


def _directives(block: re.Match[str]) -> str:
    kind, options, names = block.groups()
    write = _module if kind == "modules" else _name
    return "\n\n".join(write(name, options) for name in names.split())


def _module(name: str, options: str) -> str:
    path = name if name.startswith("ohmward_lab.") else f"ohmward.{name}"
    return f"## {name}\n\n```{{eval-rst}}\n.. automodule:: {path}\n   {options}\n```"


def _name(name: str, options: str) -> str:
    kind = "class" if isinstance(getattr(ohmward, name), type) else "function"
    return f"```{{eval-rst}}\n.. auto{kind}:: ohmward.{name}\n   :no-index:\n   {options}\n```"
