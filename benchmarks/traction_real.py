"""Speed, slip and forces on measured data, see docs/traction-data.md: `python benchmarks/traction_real.py`.

Robots and grounds are described by their data sheets and by what their user could know; nothing is tuned per file.
"""

from __future__ import annotations

from collections.abc import Iterator

import real_car
import real_husky
import real_sand
import real_warthog
import real_warthog_pose
from figure import Figure, verdict


def rows() -> Iterator[Figure]:
    for part in (real_car, real_warthog, real_warthog_pose, real_husky, real_sand):
        yield from part.rows()


if __name__ == "__main__":
    for row in rows():
        print(f"{row.data} | {row.method} | {row.quantity}: {row.value} {row.bar} {verdict(row.met)}", flush=True)
