"""Size of the package by room, and constants whose name has several values: `make house` writes benchmarks/house.md.

The counts are of the source's own syntax tree and tokens: a change of the house shows in the page's diff.
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "benchmarks" / "house.md"
#: Packages of the distribution and their rooms: the first part of a file's path, and the second for these large rooms.
PACKAGES = (ROOT / "src" / "ohmward", ROOT / "lab" / "ohmward_lab")
LARGE = {"battery", "traction", "onboard", "trace"}

_HEAD = """\
# Size of the house

Written by `make house` (`benchmarks/house.py`), so that a change of the house shows in review; no test holds these
numbers. *Code* has neither blank lines, comments, docstrings nor imports, and *share* is its part of the lines.
*Tokens* are those of a line of code: packing lines denser would show there. *Records* are named tuples, dataclasses and
structs. *Numbers* are set by hand: constants at the heads of files, and defaults of arguments and fields.
"""


class Size(NamedTuple):
    """What one file, or the files of a room, are made of."""

    files: int = 0
    lines: int = 0
    code: int = 0
    docstrings: int = 0
    imports: int = 0
    tokens: int = 0
    functions: int = 0
    records: int = 0
    numbers: int = 0

    def plus(self, other: Size) -> Size:
        """Sum of two sizes."""
        return Size(*(mine + others for mine, others in zip(self, other, strict=True)))


def size_of(text: str) -> Size:
    """Size of a file by its text."""
    tree = ast.parse(text)
    docstrings = {line for node in ast.walk(tree) for line in docstring_lines(node)}
    imports = {line for node in ast.walk(tree) if is_import(node) for line in lines_of(node)}
    tokens = Counter(line for line, _ in code_tokens(text) if line not in docstrings | imports)
    return Size(
        files=1,
        lines=len(text.splitlines()),
        code=len(tokens),
        docstrings=len(docstrings),
        imports=len(imports),
        tokens=tokens.total(),
        functions=sum(isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) for node in ast.walk(tree)),
        records=sum(isinstance(node, ast.ClassDef) and is_record(node) for node in ast.walk(tree)),
        numbers=len(list(constants(tree))) + sum(map(number_defaults, ast.walk(tree))),
    )


def code_tokens(text: str) -> Iterator[tuple[int, str]]:
    """Line and text of each token but comments and layout; a string of several lines counts on its first."""
    layout = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in layout:
            yield token.start[0], token.string


def lines_of(node: ast.stmt | ast.expr) -> range:
    """Numbers of the lines of a statement."""
    return range(node.lineno, (node.end_lineno or node.lineno) + 1)


def docstring_lines(node: ast.AST) -> range:
    """Numbers of the lines of a docstring, none where there is none."""
    if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        return range(0)
    return lines_of(node.body[0]) if ast.get_docstring(node, clean=False) is not None else range(0)


def is_import(node: ast.AST) -> bool:
    """True for an import statement."""
    return isinstance(node, ast.Import | ast.ImportFrom)


def is_record(node: ast.ClassDef) -> bool:
    """True for a named tuple, a dataclass and a msgspec struct."""
    named = {ast.unparse(base).split(".")[-1] for base in node.bases}
    decorated = {ast.unparse(mark).split("(")[0].split(".")[-1] for mark in node.decorator_list}
    return bool(named & {"NamedTuple", "Struct"}) or "dataclass" in decorated


def number(node: ast.expr | None) -> bool:
    """True for an expression of numbers alone, such as `-1e-3` or `24 * 3600`."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int | float) and not isinstance(node.value, bool)
    if isinstance(node, ast.UnaryOp):
        return number(node.operand)
    return isinstance(node, ast.BinOp) and number(node.left) and number(node.right)


def constants(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Name and value of each number at the head of a file, in tuples too: `LOW, HIGH = 1.0, 2.0`."""
    for node in tree.body:
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        value = getattr(node, "value", None)
        several = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
        for name, one in zip(target.elts, value.elts, strict=False) if several else [(target, value)]:
            if isinstance(name, ast.Name) and number(one):
                yield name.id, ast.unparse(one)


def number_defaults(node: ast.AST) -> int:
    """How many defaults of arguments or fields are numbers."""
    if isinstance(node, ast.arguments):
        return sum(number(default) for default in [*node.defaults, *node.kw_defaults])
    if isinstance(node, ast.ClassDef):
        return sum(isinstance(field, ast.AnnAssign) and number(field.value) for field in node.body)
    return 0


def room_of(package: Path, path: Path) -> str:
    """Room of a file: `battery/soc`, `filters`, or `(single files)`; rooms of the lab begin with `lab/`."""
    folders = path.relative_to(package).parts[:-1]
    name = "/".join(folders[: 2 if folders and folders[0] in LARGE else 1]) or "(single files)"
    return f"lab/{name}" if package.name == "ohmward_lab" else name


def sources() -> Iterator[tuple[Path, Path]]:
    """Package and path of each source file."""
    for package in PACKAGES:
        for path in sorted(package.rglob("*.py")):
            yield package, path


def row(cells: Iterable[object]) -> str:
    """Row of a table in Markdown."""
    return f"| {' | '.join(map(str, cells))} |"


#: Columns of the table of rooms.
COLUMNS: dict[str, Callable[[Size], object]] = {
    "files": lambda size: size.files,
    "lines": lambda size: size.lines,
    "code": lambda size: size.code,
    "share": lambda size: f"{size.code / max(size.lines, 1):.0%}",
    "docstrings": lambda size: size.docstrings,
    "imports": lambda size: size.imports,
    "tokens": lambda size: f"{size.tokens / max(size.code, 1):.1f}",
    "functions": lambda size: size.functions,
    "records": lambda size: size.records,
    "numbers": lambda size: size.numbers,
}


def size_row(name: str, size: Size) -> str:
    """Row of a room."""
    return row([name, *(column(size) for column in COLUMNS.values())])


def sizes() -> list[str]:
    """Table of the rooms, and a row for each package."""
    rooms: dict[str, Size] = defaultdict(Size)
    packages: dict[str, Size] = defaultdict(Size)
    for package, path in sources():
        size = size_of(path.read_text(encoding="utf-8"))
        rooms[room_of(package, path)] = rooms[room_of(package, path)].plus(size)
        packages[package.name] = packages[package.name].plus(size)
    head = [row(["room", *COLUMNS]), row(["---", *["---:"] * len(COLUMNS)])]
    body = [size_row(name, size) for name, size in sorted(rooms.items())]
    return [*head, *body, *(size_row(f"**{name}**", size) for name, size in packages.items())]


def names_with_several_values() -> list[str]:
    """Table of the constants that stand in several files with different values, whatever their leading underscore."""
    found: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for package, path in sources():
        for name, value in constants(ast.parse(path.read_text(encoding="utf-8"))):
            found[name.lstrip("_")][value].append(path.relative_to(package).as_posix())
    several = {name: values for name, values in found.items() if len({eval(v) for v in values}) > 1}
    lines = [row(["name", "values"]), row(["---", "---"])]
    for name, values in sorted(several.items()):
        places = "; ".join(f"{value} in {', '.join(files)}" for value, files in values.items())
        lines.append(row([f"`{name}`", places]))
    return lines


def page() -> str:
    """Text of the page."""
    heading = "## Names of constants with several values\n\nOne truth has one home; two truths have two names.\n"
    return "\n".join([_HEAD, *sizes(), "", heading, *names_with_several_values(), ""])


if __name__ == "__main__":
    text = page()
    PAGE.write_text(text, encoding="utf-8")
    sys.stdout.write(text)
