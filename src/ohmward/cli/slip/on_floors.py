"""`ohmward slip --floors`: what learnt floors say of a drive, in the shapes that `ohmward slip` shows."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from ohmward.filters.consistency import BAND_95

if TYPE_CHECKING:
    import numpy as np

    from ohmward.logs import DriveLog
    from ohmward.traction import Robot
    from ohmward.traction.speed_observer.track import SlipRun
    from ohmward.traction.terrain.slip_on_floors import FloorRun


#: What `ohmward slip --json` says of floors.
FIGURES = ("travel_slip_mean", "travel_slip_std", "floor_share", "floor_crossings")

#: Flags of samples that are told.
FAULTS = ("bad_time", "gap", "no_current", "no_encoder", "encoder_stopped")


class OnFloors(NamedTuple):
    """The drive as the floors explain it, the floors' names, and the wheels'."""

    track: FloorRun
    floors: tuple[str, ...]
    wheels: tuple[str, ...]


def observe_on_floors(robot: Robot, log: DriveLog, path: str, name: str) -> tuple[SlipRun, OnFloors, list[str]]:
    """Slip of a drive on the floors of a file; the track, what else is known, and notes.

    Raises:
        InputError: no floors in the file, no such filter, or a driven wheel without encoder or motor current.
    """
    from ohmward.traction.speed_observer.track import SlipRun
    from ohmward.traction.terrain.as_estimates import as_estimates
    from ohmward.traction.terrain.file import load_floors
    from ohmward.traction.terrain.slip_on_floors import slip_on_floors

    began = time.perf_counter()
    known = load_floors(path)
    estimator = slip_on_floors(robot, known.floor, name)
    track = estimator.run(log)
    names = ", ".join(f.name for f in known.floor) or "none"
    notes = [f"info: slip follows from motor currents on learnt floors ({names}) or one that was never met"]
    if known.robot != robot.name:
        notes.append(f"warning: the floors were learnt by {known.robot!r}, the robot is {robot.name!r}")
    notes += [
        f"warning: {n} samples with {flag.replace('_', ' ')}" for flag, n in track.counts().items() if flag in FAULTS
    ]
    places = tuple(p.name for p in robot.places[: robot.driven])
    shown = SlipRun(log.time_s, as_estimates(track, robot), time.perf_counter() - began)
    return shown, OnFloors(track, estimator.recognition.names, places), notes


def figures(on: OnFloors) -> dict[str, Any]:
    """What `ohmward slip --json` says besides."""
    import numpy as np

    moving = np.isfinite(on.track.travel_slip)
    share = on.track.floor_probability[moving].mean(axis=(0, 1)) if moving.any() else np.full(len(on.floors), np.nan)
    return {
        "travel_slip_mean": _mean(on.track.travel_slip[moving]),
        "travel_slip_std": _mean(on.track.travel_slip_std[moving]),
        "floor_share": dict(zip(on.floors, share.tolist(), strict=True)),
        "floor_crossings": [crossing._asdict() for crossing in on.track.crossings],
    }


def columns(on: OnFloors) -> dict[str, np.ndarray]:
    """Columns (T,) that the estimates file has besides."""
    found = {"travel_slip": on.track.travel_slip, "travel_slip_std": on.track.travel_slip_std}
    found |= {"speed_over_ground_m_s": on.track.speed_m_s, "speed_over_ground_std_m_s": on.track.speed_std_m_s}
    for w, wheel in enumerate(on.wheels):
        for k, floor in enumerate(on.floors):
            found[f"{wheel}_on_{floor.replace(' ', '_')}"] = on.track.floor_probability[:, w, k]
    return found


def described(f: Mapping[str, Any]) -> dict[str, str]:
    """The same for people, by name."""
    from ohmward.cli import wording

    band = BAND_95 * f["travel_slip_std"] if f["travel_slip_std"] is not None else None
    floors = ", ".join(f"{name} {wording.percent(share, 0)}" for name, share in f["floor_share"].items())
    times = ", ".join(f"{c['time_s']:.1f} s" for c in f["floor_crossings"])
    return {
        "slip of the robot": f"{wording.percent(f['travel_slip_mean'], 1)} ± {wording.percent(band, 1)} (95 %), mean",
        "floors under the wheels": floors,
        "other floor met at": times or "-",
    }


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if values.size else None
