"""Comments of the C headers: for a reader who has the header and not the Python."""

import re
from collections.abc import Callable, Iterator
from functools import partial

import pytest

from embedded.batteries import BATTERY
from ohmward.embedded import Export, battery_export, controller_export, library, observer_export, odometry_export
from ohmward.embedded.comments import field_comments
from ohmward.trace.structure import Branch, Leaf, Structure
from ohmward.traction import RLMA, hard_terrain

ESTIMATORS = ("ekf", "gsf", "textbook-joint", "coulomb", "ocv")
EXPORTS: dict[str, Callable[[], Export]] = {
    **{name: partial(battery_export, BATTERY, name, "soc") for name in ESTIMATORS},
    "observer": partial(observer_export, RLMA, hard_terrain("gravel"), "aekf"),
    "odometry": partial(odometry_export, RLMA),
    "slip controller": partial(controller_export, RLMA, "slip-controller"),
}
SHAPE = re.compile(r"/\* \([^()]*(\([^()]*\)[^()]*)*,")


def records(structure: Structure) -> Iterator[Branch]:
    """All records in a tree."""
    if isinstance(structure, Branch):
        yield structure
        for child in structure.children:
            yield from records(child)


@pytest.fixture(scope="module", params=EXPORTS)
def export(request):
    return EXPORTS[request.param]()


def test_every_member_has_a_sentence_of_its_own(export):
    for structure in export.step.step_structure:
        for record in records(structure):
            if hasattr(record.type, "_fields"):
                fields = zip(record.fields, record.children, strict=True)
                scalars = [field for field, child in fields if isinstance(child, Leaf)]
                texts = [text for field, text in field_comments(record.type).items() if field in scalars]
                assert len(set(texts)) == len(texts), record.type


def test_comments_name_neither_shapes_nor_things_of_python(export):
    header = library(export)[f"{export.name}.h"]
    for line in re.findall(r"^    .*/\*.*\*/$", header, re.MULTILINE):
        assert not SHAPE.search(line), line
        assert not re.search(r"`(?:_|\w+\.|[A-Z])", line), line
