"""Paths of the tests that a change touches, for `make check`: the core's, and those that import what has changed.

The change is what the working tree has beyond the branch `main`, or beyond its last commit on `main` itself. A test is
touched where it, or a file of tests that it imports, imports a changed module by name; what lies further away is for
`make test`.
"""

from __future__ import annotations

import ast
import subprocess
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: What everything stands on, and what holds for all files: always tested.
CORE = ("tests/trace", "tests/filters", "tests/battery/models", "tests/test_architecture.py", "tests/test_language.py")
#: Folders that modules are imported from.
SOURCES = ("src", "lab", "tests", "tests/lab", "tests/trace")


def main() -> None:
    """Print the paths, one a line."""
    print(*touched(changed_files()), sep="\n")


def changed_files() -> list[str]:
    """Files that differ from `main`, or on it from the commit before, and those that git does not know yet."""
    base = "HEAD~1" if _git("branch", "--show-current") == ["main"] else "main"
    return _git("diff", "--name-only", base) + _git("ls-files", "--others", "--exclude-standard")


def touched(changed: list[str]) -> list[str]:
    """Paths of the tests that a change of these files touches, sorted."""
    modules = {module for file in changed if file.endswith(".py") for module in _modules_of(Path(file))}
    importing = {path: set(_imported(path)) for path in sorted((ROOT / "tests").rglob("*.py"))}
    while (
        more := {
            module
            for path, imported in importing.items()
            if imported & modules and not path.name.startswith("test_")
            for module in _modules_of(path.relative_to(ROOT))
        }
        - modules
    ):
        modules |= more
    found = {str(path.relative_to(ROOT)) for path, imported in importing.items() if imported & modules}
    found |= {file for file in changed if file.startswith("tests/") and (ROOT / file).exists()}
    return sorted({*CORE, *(file for file in found if Path(file).name.startswith("test_"))})


def _modules_of(file: Path) -> Iterator[str]:
    """Names by which a file is imported."""
    for source in SOURCES:
        if file.is_relative_to(source):
            parts = file.relative_to(source).with_suffix("").parts
            yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imported(path: Path) -> Iterator[str]:
    """Modules that a file imports, and `module.name` of what it imports from them."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _git(*words: str) -> list[str]:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.split("\n")[:-1] if done.returncode == 0 else []


if __name__ == "__main__":
    main()
