"""The two drives of [T] (figures 5.6 to 5.9) in MuJoCo: slip from the observer against slip from raw counts.

Case I: braking at -0.18 on the slippery floor, from 1 m/s. Case II: 0.12 on the normal floor, from 6 s on -0.18 on the
slippery one. The robot starts at rest in both: an observer knows a speed from there. `python benchmarks/slip_cases.py`
draws them into docs/pictures.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from figure import rms
from ohmward.report import TIME, Figure, Series
from ohmward.traction.control import Measurement, SlipCommand, SlipController, SpeedCommand, SpeedController
from ohmward_lab.simulate.ground import Patch
from ohmward_lab.simulate.mujoco_plant import RlmaPlant
from slip_loops import DRAG, LIMITS, WHEEL, WIDER, Observed, Sensors, Stepper, observed_run
from svg import to_svg

NORMAL, SLIPPERY = 0.8, 0.2
DRIVE, BRAKE = 0.12, -0.18
#: The robot of [T] has encoders on all wheels; the IMU is ours.
SENSORS = Sensors(passive=True)
SEED = 5
PICTURES = Path(__file__).resolve().parents[1] / "docs" / "pictures"
#: Every so many milliseconds is drawn; slip below this speed means nothing.
THIN, SLOWEST_M_S = 8, 0.1


class Case(NamedTuple):
    """A drive. switch_s: when floor and command change; end_s: of the recording; slip_ratio: before the switch, or None
    where the robot drives to 1 m/s."""

    name: str
    switch_s: float
    end_s: float
    slip_ratio: float | None


CASES = (Case("I", 3.0, 4.2, None), Case("II", 6.0, 8.5, DRIVE))


def drive(case: Case, raw: bool) -> Observed:
    """The case with the slip from the observer, or from counts."""
    control = SlipController(WHEEL, WIDER, LIMITS)
    braking = Stepper(control, lambda _: SlipCommand(BRAKE))
    driving = (
        Stepper(SpeedController(WHEEL, WIDER, LIMITS), lambda _: SpeedCommand(1.0))
        if case.slip_ratio is None
        else Stepper(control, lambda _: SlipCommand(DRIVE))
    )

    def step(time_s: float, m: Measurement) -> np.ndarray:
        return driving(time_s, m) if time_s < case.switch_s else braking(time_s, m)

    plant = RlmaPlant(DRAG, [Patch(friction=NORMAL), Patch(friction=SLIPPERY, from_s=case.switch_s)])
    return observed_run(step, plant, case.end_s, SENSORS, SEED, raw)


def case_rows() -> Iterator[str]:
    """Lines of the table."""
    for case in CASES:
        for raw in (False, True):
            o = drive(case, raw)
            t, v, error = o.truth.time_s, o.truth.speed_m_s, o.truth.slip_ratio[:, 0]
            braking = (t > case.switch_s + 0.15) & (v > 0.25)
            driving = (t > 1.0) & (t < case.switch_s)
            first = f"{rms(error[driving] - DRIVE):.4f}" if case.slip_ratio else ""
            change = rms(np.diff(o.truth.torque_N_m[t > 0.5, 0]))
            source = "counts over 10 ms" if raw else "observer"
            yield f"| {case.name} | {source} | {first} | {rms(error[braking] - BRAKE):.4f} | {change:.3f} |"


def figures(case: Case) -> Iterator[Figure]:
    """Speeds, slip and torque over time, with the slip from the observer and from counts."""
    seen, raw = drive(case, raw=False), drive(case, raw=True)
    t, every = seen.truth.time_s[::THIN], slice(None, None, THIN)
    target = np.where(t < case.switch_s, case.slip_ratio or np.nan, BRAKE)
    yield Figure(
        f"Case {case.name} of [T] in MuJoCo",
        TIME,
        "Speed [m/s]",
        [
            Series(t, seen.truth.speed_m_s[every], "robot", "dashed", "reference"),
            Series(t, WHEEL.radius_m * seen.truth.wheel_speed_rad_s[every, 0], "rim of a front wheel"),
            Series(t, seen.estimate.speed_m_s[every], "observer", role="estimate"),
        ],
        height_px=150,
    )
    yield Figure(
        "True slip of a front wheel",
        TIME,
        "Slip ratio",
        [
            Series(t, target, "wanted", "dashed", "reference"),
            Series(t, moving_slip(raw)[every], "controlled on counts", role="comparison"),
            Series(t, moving_slip(seen)[every], "controlled on the observer", role="estimate"),
        ],
        height_px=200,
    )
    yield Figure(
        "Torque of its motor",
        TIME,
        "Torque [N m]",
        [
            Series(t, raw.truth.torque_N_m[every, 0], "on counts", role="comparison"),
            Series(t, seen.truth.torque_N_m[every, 0], "on the observer", role="estimate"),
        ],
        height_px=150,
    )


def moving_slip(o: Observed) -> np.ndarray:
    """Slip ratio (T,) where the robot moves, else nan."""
    return np.where(o.truth.speed_m_s > SLOWEST_M_S, o.truth.slip_ratio[:, 0], np.nan)


def main() -> None:
    """Draw the pictures of the documentation."""
    for case in CASES:
        (PICTURES / f"slip-case-{case.name.lower()}.svg").write_text(to_svg(*figures(case)), encoding="utf-8")


if __name__ == "__main__":
    main()
