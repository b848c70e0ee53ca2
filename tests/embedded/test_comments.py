"""Comments of the C headers: for a reader who has the header and not the Python."""

import re
from collections.abc import Iterator

import pytest

from embedded.batteries import BATTERY
from ohmward.embedded import battery_export, controller_export, library, observer_export, odometry_export
from ohmward.embedded.comments import field_comments
from ohmward.trace.structure import Branch, Leaf, Structure
from ohmward.traction import RLMA, hard_terrain

EXPORTS = {
    **{name: battery_export(BATTERY, name, "soc") for name in ("ekf", "gsf", "textbook-joint", "coulomb", "ocv")},
    "observer": observer_export(RLMA, hard_terrain("gravel"), "aekf"),
    "odometry": odometry_export(RLMA),
    "slip controller": controller_export(RLMA, "slip-controller"),
}
SHAPE = re.compile(r"/\* \([^()]*(\([^()]*\)[^()]*)*,")


def records(structure: Structure) -> Iterator[Branch]:
    """All records in a tree."""
    if isinstance(structure, Branch):
        yield structure
        for child in structure.children:
            yield from records(child)


@pytest.mark.parametrize("name", EXPORTS)
def test_every_member_has_a_sentence_of_its_own(name):
    for structure in EXPORTS[name].step.step_structure:
        for record in records(structure):
            if hasattr(record.type, "_fields"):
                fields = zip(record.fields, record.children, strict=True)
                scalars = [field for field, child in fields if isinstance(child, Leaf)]
                texts = [text for field, text in field_comments(record.type).items() if field in scalars]
                assert len(set(texts)) == len(texts), record.type


@pytest.mark.parametrize("name", EXPORTS)
def test_comments_name_neither_shapes_nor_things_of_python(name):
    header = library(EXPORTS[name])[f"{EXPORTS[name].name}.h"]
    for line in re.findall(r"^    .*/\*.*\*/$", header, re.MULTILINE):
        assert not SHAPE.search(line), line
        assert not re.search(r"`(?:_|\w+\.|[A-Z])", line), line
