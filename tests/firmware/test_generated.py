"""The committed C libraries are those that the code of today generates."""

import pytest

from ohmward.embedded import library
from scripts import script

generate = script("generate", "firmware")
ADVICE = "the C on the chip changes; if it should, run `python firmware/generate.py` and commit the difference"


@pytest.mark.parametrize("folder", ["battery", "traction"])
def test_the_committed_library_is_the_generated_one(folder):
    generated = library(generate.exports()[folder])
    committed = {path.name: path.read_bytes() for path in (generate.GENERATED / folder).iterdir()}
    assert sorted(committed) == sorted(generated), ADVICE
    changed = [name for name, text in generated.items() if committed[name] != text.encode()]
    assert not changed, f"{', '.join(changed)}: {ADVICE}"


def test_each_library_is_small_enough_to_read():
    for folder in generate.GENERATED.iterdir():
        assert sum(path.stat().st_size for path in folder.iterdir()) < 100_000
