"""The page that adds a parameter to the cell does it, in a copy of the package."""

import os
import re
import shutil
import subprocess
import sys

from markdown_pages import ROOT

PAGE = ROOT / "docs" / "add-a-parameter.md"
TEST = "test_parameter.py"


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def changed(text: str, hunk: str) -> str:
    """The text with one hunk of a diff, whose old lines it must have once."""
    lines = hunk.splitlines(keepends=True)
    old = "".join(line[1:] for line in lines if line[0] in " -")
    new = "".join(line[1:] for line in lines if line[0] in " +")
    assert text.count(old) == 1, f"the page and the code disagree on\n{old}"
    return text.replace(old, new)


def test_three_files_add_a_parameter(tmp_path):
    for package in ("src", "lab"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    files = set()
    for block in blocks("diff"):
        header, *rest = block.splitlines(keepends=True)
        file = header.removeprefix("--- ").strip()
        files.add(file)
        text = (tmp_path / file).read_text(encoding="utf-8")
        for hunk in "".join(rest).split("@@\n"):
            text = changed(text, hunk)
        (tmp_path / file).write_text(text, encoding="utf-8")
    (test,) = blocks(r"\{code-block\} python")
    (tmp_path / TEST).write_text(test, encoding="utf-8")
    assert len({*files, TEST}) == 3
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(str(tmp_path / package) for package in ("src", "lab"))}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", os.devnull, str(tmp_path / TEST)]
    found = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr
    assert "2 passed" in found.stdout
