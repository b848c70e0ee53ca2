"""Small simulated recordings for examples and notebooks; docs/make_example_data.py makes them.

| name | what it is |
|---|---|
| `lg-m50-pulse-test`, `lg-m50-drive-25degC`, `lg-m50-drive-10degC` | a 5 Ah NMC cell: a pulse test, and days of use |
| `amr-1_2026-03-02` ... | days of three robots, 4 NMC cells of 5 Ah in series; the battery of `amr-2` is worn |
| `pack-with-a-weak-cell` | a day of 4 LFP cells in series with their voltages |
| `turtlebot4` | a recording of ROS 2: wheel angles, gyro, battery |
"""

from __future__ import annotations

from pathlib import Path

from ohmward.errors import InputError

FOLDER = Path(__file__).parent / "recordings"


def example(name: str) -> Path:
    """The path of a recording.

    Raises:
        InputError: there is none of that name; lists all.
    """
    names = {path.stem: path for path in sorted(FOLDER.iterdir())}
    if name not in names:
        raise InputError(f"the example must be one of {', '.join(names)}; got {name!r}")
    return names[name]


def examples(start: str) -> list[Path]:
    """The paths of all recordings whose names begin with `start`, sorted by name."""
    return [path for path in sorted(FOLDER.iterdir()) if path.name.startswith(start)]
