"""Imports point one way, between rooms and between files; the on-board core needs NumPy alone; importing is quick."""

import ast
import re
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

import ohmward
import ohmward_lab
from ohmward.cli.main import COMMANDS

SOURCE = Path(ohmward.__file__).parent
LAB = Path(ohmward_lab.__file__).parent
DOCS = Path(__file__).parent.parent / "docs"

#: What each room may import from the rooms below it; a room of its own is always allowed.
GROUND = {
    *("errors", "checks", "atomic", "memory", "optional", "runs", "toml_file", "json_values", "lab", "quantities"),
    *("rich_display", "signals"),
}
LOGS = {"logs.log", "logs.drive_log"}
CORE = {"battery", "traction", "trace", "filters"} | GROUND
BELOW: dict[str, set[str]] = {
    "errors": set(),
    "lab": set(),
    "checks": {"errors"},
    "atomic": {"errors"},
    "optional": {"errors"},
    "json_values": set(),
    "memory": set(),
    "rich_display": set(),
    "quantities": {"errors"},
    "runs": set(),
    "signals": {"errors", "quantities", "runs"},
    "toml_file": {"errors", "checks", "atomic", "optional"},
    "trace": GROUND,
    "filters": {"trace"} | GROUND,
    "logs": GROUND,
    "report": GROUND,
    "battery": {"trace", "filters", "logs.log", "logs.ocv_table", "logs.battery_columns"} | GROUND,
    "traction": {"trace", "filters"} | LOGS | GROUND,
    "energy": {"logs.columns", "logs.units"} | CORE | LOGS,
    "embedded": CORE | LOGS,
    "fleet": {"battery", "trace", "filters", "logs"} | GROUND,
    "figures": {"energy", "report"} | CORE | LOGS,
    "onboard": {"energy", "logs", "report"} | CORE,
    "cli": {"onboard", "fleet", "energy", "embedded", "figures", "logs", "report"} | CORE,
    "__main__": {"cli.main"},
    # the laboratory imports the product; nothing in the product imports it
    "ohmward_lab.published": {"embedded"} | CORE | LOGS,
    "ohmward_lab.traction": CORE | LOGS,
    "ohmward_lab.simulate": {"ohmward_lab.published", "ohmward_lab.traction", "energy", "logs"} | CORE,
    "ohmward_lab.examples": {"errors"},
    "ohmward_lab.onboard": {"ohmward_lab.simulate", "onboard", "logs"} | CORE,
    "ohmward_lab.reproduce": {"ohmward_lab.published", "ohmward_lab.simulate", "figures", "logs", "report"} | CORE,
    "ohmward_lab.assess": {
        *("ohmward_lab.published", "ohmward_lab.simulate", "ohmward_lab.traction", "fleet", "logs"),
        *CORE,
    },
    "ohmward_lab.cli": {
        *("ohmward_lab.assess", "ohmward_lab.reproduce", "ohmward_lab.simulate", "ohmward_lab.published"),
        *("cli", "energy", "figures", "fleet", "logs", "report"),
    }
    | CORE,
}

#: Modules that load another one by its name: the names of a package, a command, an optional package, the laboratory,
#: and the figures of a result, which stand above it.
BY_NAME = ["cli.main", "lab", "logs", "optional", "rich_display"]

#: What runs on a robot.
ON_BOARD = [
    "ohmward.battery.soc.thevenin_filter",
    "ohmward.battery.soc.registry",
    "ohmward.battery.soc.estimator",
    "ohmward.battery.cells.pack_estimator",
    "ohmward.battery.file",
    "ohmward.filters",
    "ohmward.trace",
    "ohmward.logs.drive_log",
    "ohmward.logs.log",
    "ohmward.traction",
    "ohmward.traction.speed_observer",
    "ohmward.traction.control",
    "ohmward.traction.terrain",
    "ohmward.energy",
]

#: What an on-board core must not pull in, however it is installed.
HEAVY = ["scipy", "pyarrow", "msgspec", "rich", "matplotlib", "pandas", "llvmlite", "numba", "casadi", "sympy"]


def modules() -> list[str]:
    """Every module: those of ohmward without its name, those of the laboratory with it."""
    files = dict.fromkeys(SOURCE.rglob("*.py"), SOURCE) | dict.fromkeys(LAB.rglob("*.py"), LAB.parent)
    names = sorted(".".join(file.relative_to(top).with_suffix("").parts) for file, top in files.items())
    return [name.removesuffix(".__init__") for name in names if name not in ("__init__", "ohmward_lab.__init__")]


def text_of(module: str) -> str:
    path = (LAB.parent if module.startswith("ohmward_lab.") else SOURCE).joinpath(*module.split("."))
    of_folder = path / "__init__.py"
    return (of_folder if of_folder.exists() else path.with_suffix(".py")).read_text(encoding="utf-8")


def room_of(module: str) -> str:
    return ".".join(module.split(".")[: 2 if module.startswith("ohmward_lab.") else 1])


class Imports(NamedTuple):
    """Modules of ohmward that a module imports, called as in `modules`."""

    all: frozenset[str]
    late: frozenset[str]  #: those within a function


@cache
def imports_of(module: str) -> Imports:
    nodes = list(ast.walk(ast.parse(text_of(module))))
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    inside = [node for function in functions for node in ast.walk(function)]
    return Imports(*(frozenset(own(module, part)) for part in (nodes, inside)))


def own(module: str, nodes: list[ast.AST]) -> set[str]:
    names = {a.name for node in nodes if isinstance(node, ast.Import) for a in node.names}
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: imports are absolute here"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    ours = {name.removeprefix("ohmward.") for name in names if name.startswith(("ohmward.", "ohmward_lab."))}
    return {name if name in MODULES else name.rpartition(".")[0] or name for name in ours}


def allowed(module: str, target: str) -> bool:
    room = room_of(module)
    permitted = {room, "__version__"} | BELOW[room]
    return any(target == name or target.startswith(f"{name}.") for name in permitted)


MODULES = frozenset(modules())


def run(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_every_room_has_its_place():
    """Say in BELOW what a new subpackage may import, and in docs/architecture.md what it is."""
    assert {room_of(module) for module in MODULES} == set(BELOW)


def test_imports_point_downwards():
    upwards = {module: {t for t in imports_of(module).all if not allowed(module, t)} for module in MODULES}
    assert {module: targets for module, targets in upwards.items() if targets} == {}


def test_modules_are_loaded_by_name_in_few_places():
    assert [module for module in modules() if "import_module" in text_of(module)] == BY_NAME


def test_the_files_form_no_circle():
    below = {module: imports_of(module).all & MODULES - {module} for module in MODULES}
    try:
        TopologicalSorter(below).prepare()
    except CycleError as circle:
        pytest.fail(f"these files import each other: {' -> '.join(circle.args[1])}")


def test_own_modules_are_imported_at_the_top():
    """But optional packages, commands, which are loaded by name, and what a command of one file needs for its work.

    The script loads the command line where it answers an interrupt.
    """
    commands = {f"cli.{name}" for name in COMMANDS} | {"__main__"}
    assert {module: late for module in MODULES - commands if (late := imports_of(module).late)} == {}


def test_the_rooms_form_no_circle():
    seen: set[str] = set()
    for room, below in BELOW.items():
        assert {room_of(name) for name in below} <= seen, f"{room} imports from a room above it"
        seen.add(room)


def test_the_on_board_core_imports_numpy_alone():
    """In one process, which says after each module what is loaded by then."""
    say = "print(name, *{name.split('.')[0] for name in sys.modules})"
    found = run(f"import importlib, sys\nfor name in {ON_BOARD}:\n    importlib.import_module(name)\n    {say}")
    loaded = {name: set(packages) for name, *packages in map(str.split, found.splitlines())}
    assert {name: heavy for name, packages in loaded.items() if (heavy := packages & set(HEAVY))} == {}
    assert list(loaded) == ON_BOARD and "numpy" in loaded[ON_BOARD[0]]


def test_the_package_itself_imports_nothing():
    loaded = run("import sys; before = set(sys.modules); import ohmward; print(*(set(sys.modules) - before))").split()
    assert "numpy" not in loaded
    assert {name for name in loaded if name.startswith("ohmward.")} == set()


def test_every_public_name_is_found_and_typed():
    tree = ast.parse((SOURCE / "__init__.py").read_text(encoding="utf-8"))
    typed = [node for node in ast.walk(tree) if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)]
    names = [a.name for node in typed[0].body if isinstance(node, ast.ImportFrom) for a in node.names]
    assert sorted(names) == sorted(ohmward.__all__)
    for name in ohmward.__all__:
        assert getattr(ohmward, name).__name__ == name
        assert name in dir(ohmward)


def listed(kind: str) -> list[str]:
    """Names in the blocks of a kind on the pages of the reference, which an extension of the documentation expands."""
    pages = "\n".join(page.read_text(encoding="utf-8") for page in (DOCS / "reference").glob("*.md"))
    blocks = re.findall(rf"^```\{{{kind}\}}[^\n]*\n(.*?)^```$", pages, re.DOTALL | re.MULTILINE)
    return [name for block in blocks for name in block.split()]


def test_public_names_are_few_and_each_is_in_the_reference():
    assert len(ohmward.__all__) <= 45
    assert sorted(listed("names")) == sorted(ohmward.__all__)


def test_the_reference_names_files_that_there_are():
    files = [name for name in listed("modules") if not name.startswith("ohmward_lab.")]
    assert files
    assert set(files) <= set(modules())


def test_an_estimator_of_charge_loads_no_reader_of_drives_and_no_figure():
    loaded = run("import sys; from ohmward import SocEstimator; print(*sys.modules)").split()
    assert [
        name for name in loaded if re.match(r"ohmward\.(logs\.(drive|doctor|write)|figures|report|traction)", name)
    ] == []


def test_a_name_that_does_not_exist_is_refused():
    with pytest.raises(AttributeError, match="module 'ohmward' has no attribute 'idnetify'"):
        ohmward.idnetify  # noqa: B018
