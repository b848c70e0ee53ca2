"""The field's words: a class name stands once, and private words stay out of the code."""

import ast
import io
import re
import tokenize
from collections import defaultdict
from functools import cache
from pathlib import Path

import ohmward
import ohmward_lab
from markdown_pages import name_of

ROOMS = Path(ohmward.__file__).parent, Path(ohmward_lab.__file__).parent
FILES = sorted(path for room in ROOMS for path in room.rglob("*.py"))

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
    "carried": "supported",
    "Charge": "BatteryState",
    "Need": "EnergyDemand",
    "Outlook": "MissionForecast",
    "Identification": "Provenance",
}

#: Words that no identifier may have in it, alone or in a compound: `try_bent` as little as `bent`.
PRIVATE_INSIDE = {
    "told": "given, reported",
    "untold": "pending",
    "lesson": "update",
    "taught": "learnt, information",
    "untaught": "not identified",
    "wander": "walk",
    "anew": "restarted",
    "believed": "prior, estimated, used",
    "doubt": "uncertainty, standard deviation",
    "hill": "mode, peak",
    "bend": "curvature, curve shape",
    "bent": "curvature, curve shape",
    "unseen": "new, unobserved, unvisited",
    "shown": "measured, observable",
    "pushed": "disturbed",
    "quiet": "below the rest threshold",
    "say": "report, contain, declare",
    "said": "reported, declared",
    "teach": "inform",
    "kept": "stored",
    "hear": "receive, observe",
}


@cache
def identifiers(path: Path) -> frozenset[str]:
    text = path.read_text(encoding="utf-8")
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return frozenset(t.string for t in tokens if t.type == tokenize.NAME)


def test_no_class_name_stands_twice():
    places = defaultdict(list)
    for path in FILES:
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef):
                places[node.name].append(name_of(path))
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_names_are_those_of_the_field():
    found = {name_of(path): words for path in FILES if (words := identifiers(path) & set(PRIVATE))}
    assert found == {}, f"take the field's word instead: {PRIVATE}"


def test_names_have_no_private_word_inside():
    found = defaultdict(set)
    for path in FILES:
        for name in identifiers(path):
            if PRIVATE_INSIDE.keys() & {word.removesuffix("s") for word in words_in(name)}:
                found[name_of(path)].add(name)
    assert found == {}, f"take the field's word instead: {PRIVATE_INSIDE}"


def words_in(name: str) -> list[str]:
    """Words of an identifier, split at underscores and capitals."""
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]
