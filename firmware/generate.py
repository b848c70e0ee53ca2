"""Generate the two libraries that are committed: `python firmware/generate.py`.

One filter of a battery and one controller of a wheel stand for their families. They are committed, so that a change of
what runs on the chip is seen in review, and `tests/firmware/test_generated.py` generates them again and compares.
"""

from __future__ import annotations

from pathlib import Path

from ohmward.battery.chemistries import generic_battery
from ohmward.embedded import Export, battery_export, controller_export, library, write_library
from ohmward.traction import RLMA

GENERATED = Path(__file__).resolve().parent / "generated"


def exports() -> dict[str, Export]:
    """The committed libraries, by their folder."""
    battery = generic_battery("lfp", 12.0, n_series=4)
    return {
        "battery": battery_export(battery, "textbook-ukf", "soc", sample_time_s=1.0),
        "traction": controller_export(RLMA, "slip-controller", "slip"),
    }


def main() -> None:
    """Write both libraries."""
    for folder, export in exports().items():
        write_library(library(export), GENERATED / folder)


if __name__ == "__main__":
    main()
