"""The field's words: a class name stands once, a docstring names the thing, and private words stay out of the code."""

import ast
import io
import re
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import ohmward

SOURCE = Path(ohmward.__file__).parent
FILES = sorted(SOURCE.rglob("*.py"))
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}

#: Words that a reader of the field would have to learn first, and those of the field.
PRIVATE = {
    "Reading": "CleanSample",
    "surprise": "gate",
    "doubtful_s": "rejected_s",
    "patience_s": "reset_after_s",
    "capacity_share": "soh_capacity",
    "resistance_share": "resistance_ratio",
    "let_go": "gross_slip",
    "reconsider": "test_hypotheses",
    "unusualness": "squared_mahalanobis",
    "bend": "curve shape",
    "bend_std": "curve_shape_std",
    "bend_s": "curve_shape_correlation_s",
    "bend_response": "curve_shape_noise",
    "kept": "decay factor",
    "lasting": "Gauss-Markov state",
    "walked": "process variance",
    "mosaic": "terrain_mixture",
    "Account": "EnergyBalance",
    "Work": "EnergyBalance",
    "PowerSplit": "EnergyBalance",
    "booked": "accumulate",
    "gap_J": "residual_J",
    "warmth": "arrhenius_factor",
    "half_gap_V": "hysteresis_at_V",
    "partly_linear": "conditionally_linear",
    "observer_for": "make_observer",
    "push": "disturbance",
    "pushed": "disturbed",
    "carried": "supported",
    "shown": "observable",
    "Charge": "BatteryState",
    "Need": "EnergyDemand",
    "Outlook": "MissionForecast",
    "Identification": "Provenance",
    "quiet": "below the rest threshold",
    "quiet_A": "rest_threshold_A",
}


def documented() -> Iterator[tuple[str, str]]:
    """Every module, class and function with a docstring: where it stands, and the docstring's first line."""
    for path, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                text = ast.get_docstring(node)
                if text:
                    place = f"{path.relative_to(SOURCE)}:{getattr(node, 'lineno', 1)}"
                    yield place, text.splitlines()[0]


def identifiers(path: Path) -> set[str]:
    text = path.read_text(encoding="utf-8")
    return {t.string for t in tokenize.generate_tokens(io.StringIO(text).readline) if t.type == tokenize.NAME}


def test_no_class_name_stands_twice():
    places = defaultdict(list)
    for path, tree in TREES.items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                places[node.name].append(str(path.relative_to(SOURCE)))
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_a_docstring_names_the_thing():
    riddles = [f"{place} {line}" for place, line in documented() if re.match(r"(What|How|Whether|Where)\b", line)]
    assert riddles == []


def test_names_are_those_of_the_field():
    found = {str(path.relative_to(SOURCE)): words for path in FILES if (words := identifiers(path) & set(PRIVATE))}
    assert found == {}, f"take the field's word instead: {PRIVATE}"


def test_files_and_functions_are_short():
    long_files = {str(p): n for p in FILES if (n := len(p.read_text(encoding="utf-8").splitlines())) > 400}
    assert long_files == {}
    assert [place for place, lines in function_lengths() if lines > 40] == []


def function_lengths() -> Iterator[tuple[str, int]]:
    """Every function and its lines without the docstring."""
    for path, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                text = ast.get_docstring(node, clean=False)
                docstring = len(text.splitlines()) if text else 0
                yield (
                    f"{path.relative_to(SOURCE)}:{node.lineno} {node.name}",
                    (node.end_lineno or 0) - node.lineno + 1 - docstring,
                )
