"""The notebooks of the documentation as programs: their cells, run one after the other as Jupyter would."""

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[1] / "docs" / "notebooks"


def notebooks() -> list[Path]:
    return sorted(FOLDER.glob("*.md"))


def cells(notebook: Path) -> list[tuple[bool, str]]:
    """Whether a cell gives the picture of the gallery, and its code."""
    blocks = re.findall(r"^```\{code-cell\} python\n(.*?)^```", notebook.read_text(encoding="utf-8"), re.M | re.S)
    return [(":tags: [thumbnail]" in block, re.sub(r"^:tags:.*\n+", "", block)) for block in blocks]


def run_notebook(notebook: Path) -> tuple[list[Any], Any]:
    """Run the cells in the working folder; what each of them shows, and the picture of the gallery."""
    names: dict[str, Any] = {"__name__": "__main__"}
    shown, picture = [], None
    for is_picture, code in cells(notebook):
        if code.startswith("!"):
            subprocess.run(_with_values(code[1:], names), shell=True, check=True, executable=shutil.which("bash"))
            continue
        value = _run(code, names, notebook.name)
        shown.append(value)
        picture = value if is_picture else picture
    return shown, picture


def _with_values(line: str, names: dict[str, Any]) -> str:
    """A line for the shell with the command of this environment, and the values of the names in braces."""
    line = re.sub(r"\{(\w+)\}", lambda match: str(names[match[1]]), line.strip())
    return re.sub(r"^ohmward\b", f"{sys.executable} -m ohmward", line)


def _run(code: str, names: dict[str, Any], file: str) -> Any:
    """Run a cell; the value of its last expression, None where it ends otherwise."""
    tree = ast.parse(code)
    *before, last = tree.body
    if not isinstance(last, ast.Expr):
        return exec(compile(tree, file, "exec"), names)
    exec(compile(ast.Module(before, []), file, "exec"), names)
    return eval(compile(ast.Expression(last.value), file, "eval"), names)


def skip_without_compiler(notebook: Path) -> None:
    if "Twin" in notebook.read_text(encoding="utf-8") and not shutil.which("cc"):
        pytest.skip("needs a C compiler")
