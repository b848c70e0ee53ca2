"""Pose from wheels and a gyro beside plain wheels and robot_localization's filter: `python benchmarks/pose_peers.py`.

The same samples for each, with default settings: writes `benchmarks/pose_peers.md`. No drive here chose a setting of
ohmward; its noise was chosen on runs of other seeds of the plants.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from figure import HERE, rms, table
from odometry import (
    DT_S,
    MUJOCO,
    OWN,
    Recording,
    driven,
    measured,
    mujoco_plant,
    own_plant,
    reckoned,
    stopping,
    without_offset,
)
from ohmward.traction import RLMA, Odometry, Robot
from ohmward.traction.robot.robot import motion_from_wheels
from ohmward_lab.simulate.closed_loop import Patch
from ohmward_lab.simulate.closed_loop.traction_plant import TractionPlant
from ohmward_lab.simulate.robot_sensors import GYRO
from peers import in_robot_localization
from real_warthog import STEP_S, Windows, in_two_steps, recording
from real_warthog_pose import DELAYS, LAST, Moved, by_odometry, by_wheels, error_at_best, later, poses

PAGE = HERE / "pose_peers.md"
#: Seeds of the drives, and their number.
FIRST_SEED, RUNS = 4000, 16
OURS, PEER = "ohmward", "robot_localization's EKF"
WHEELS, AT_REST = "wheels alone", "wheels, and the gyro less its mean at rest"
#: Ice under one driven wheel: friction, and its length and distance [s].
ICE, ICE_S, EVERY_S = 0.05, 3.0, 15.0
DRIVES_S = 600.0


def main() -> None:
    """Drive, estimate and write the page."""
    rows: list[Sequence[str]] = []
    for name, runs in drives():
        rows += simulated(name, runs)
        print(f"{name}: done")
    rows += measured_rows()
    head = ("drives", "by", "error at the end over the way, mean", "NEES of the pose, mean (3 is right)")
    PAGE.write_text("\n".join([TEXT, "", *table(head, rows), ""]), encoding="utf-8")


#: What the page says before its table.
TEXT = f"""\
Written by `make pose-peers`. Simulated: {RUNS} drives each of [T]'s robot at 50 Hz, 1024 counts a turn,
each with a radius (0.5 %), unequal wheels, and a scale and an offset of the gyro of its own; on our plant, on MuJoCo's,
whose four fixed wheels scrub, and with ice under one driven wheel for {ICE_S:g} of every {EVERY_S:g} s. Measured:
windows of {LAST * STEP_S:.2f} s of a skid-steered Clearpath Warthog with calibrated radius and track
(`real_warthog_pose.py`), errors of chord and turn against lidar. Each gets the same samples and has its default
settings; no drive here chose one of ohmward's. {PEER} is a NumPy version of its documented arithmetic, with
the noise of its documentation and of `diff_drive_controller`, and the gyro less its mean at the first rest, as it has
no state for the offset."""


def drives() -> Iterator[tuple[str, list[Recording]]]:
    """Simulated drives by name."""
    seeds = range(FIRST_SEED, FIRST_SEED + RUNS)
    for name, way, plant, gains in (
        ("stop and go, 100 m", stopping, own_plant, OWN),
        ("four fixed wheels, 50 m", driven, mujoco_plant, MUJOCO),
        ("one wheel on ice, 50 m", driven, icy_plant, OWN),
    ):
        truths = (way(plant(rng), gains, rng) for rng in map(np.random.default_rng, seeds))
        yield name, [measured(t, np.random.default_rng(s), 1024) for t, s in zip(truths, seeds, strict=True)]


def icy_plant(rng: np.random.Generator) -> TractionPlant:
    """The plant of our own with ice under one driven wheel now and then."""
    ground = [Patch(friction=float(rng.uniform(0.5, 0.9)), rolling=0.02)]
    for k, start_s in enumerate(np.arange(10.0, DRIVES_S, EVERY_S).tolist()):
        wheel = ("front_left", "front_right")[k % 2]
        ground.append(Patch(friction=ICE, rolling=0.02, from_s=start_s, to_s=start_s + ICE_S, wheels=(wheel,)))
    return TractionPlant(RLMA, ground, longest_step_s=0.01)


def simulated(name: str, runs: Sequence[Recording]) -> Iterator[Sequence[str]]:
    """Rows of simulated drives."""
    errors: dict[str, list[float]] = {WHEELS: [], AT_REST: [], PEER: [], OURS: []}
    nees: dict[str, list[float]] = {name: [] for name in errors}
    for run in runs:
        way_m = float(np.hypot(*np.diff(run.pose[:, :2], axis=0).T).sum())
        for plain, position in zip((WHEELS, AT_REST), reckoned(run.log), strict=True):
            errors[plain].append(float(np.hypot(*(position - run.pose[-1, :2]))) / way_m)
        speeds = run.log.wheel_speed_rad_s.copy()
        speeds[:, RLMA.driven :] = np.nan
        motion = motion_from_wheels(RLMA, speeds[:, : RLMA.driven])
        gyro = np.asarray(run.log.yaw_rate_rad_s)
        theirs = in_robot_localization.run(np.full(len(gyro), DT_S), *motion.T, without_offset(run.log), GYRO.noise_std)
        log = run.log.__class__("run", run.log.time_s, speeds, np.full((len(gyro), 2), np.nan), yaw_rate_rad_s=gyro)
        e = Odometry(RLMA).run(log).estimates
        ours = in_robot_localization.Track(np.array([e.x_m[-1], e.y_m[-1], e.yaw_rad[-1]]), e.pose_cov[-1])
        for by, track in ((PEER, theirs), (OURS, ours)):
            error = track.pose - run.pose[-1]
            errors[by].append(float(np.hypot(*error[:2])) / way_m)
            nees[by].append(float(error @ np.linalg.solve(track.cov, error)))
    for by, values in errors.items():
        yield name, by, f"{np.mean(values):.2%}", f"{np.mean(nees[by]):.1f}" if nees[by] else ""


def measured_rows() -> Iterator[Sequence[str]]:
    """Rows of the Warthog: errors of chord and turn."""
    windows, lidar = recording(), poses()
    robot = in_two_steps(windows)
    seen = [later(lidar, late) for late in DELAYS]
    ways = {WHEELS: by_wheels(windows, robot), PEER: by_peer(windows, robot), OURS: by_odometry(windows, robot)}
    for by, way in ways.items():
        chord, turn = (
            rms(error_at_best(way, seen, part, ~windows.held_out)[0][windows.held_out])
            for part in ("chord_m", "turn_rad")
        )
        yield "Warthog, measured", by, f"{chord:.3f} m, {turn:.3f} rad", ""


def by_peer(windows: Windows, robot: Robot) -> Moved:
    """Each window by the filter of robot_localization."""
    moved, radius_m, track_m = [], robot.wheel.radius_m, robot.chassis.turning_track_m  # type: ignore[union-attr]
    for left, right, gyro in zip(windows.left_rad_s, windows.right_rad_s, windows.gyro_rad_s, strict=True):
        rims = radius_m * np.array([left, right])[:, 1 : LAST + 1]
        speed, turn = rims.mean(axis=0), (rims[1] - rims[0]) / track_m
        track = in_robot_localization.run(np.full(LAST, STEP_S), speed, turn, gyro[1 : LAST + 1], GYRO.noise_std)
        moved.append((np.hypot(*track.pose[:2]), track.pose[2], np.sqrt(track.cov[2, 2])))
    return Moved(*np.array(moved).T)


if __name__ == "__main__":
    main()
