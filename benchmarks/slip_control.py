"""Slip control on the robot in MuJoCo: `make slip-control` writes benchmarks/slip_control.md."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from figure import HERE, Figure, at_most
from ohmward.traction.control import SlipCommand, SlipController, SpeedCommand, SpeedController
from ohmward_lab.simulate.ground import Patch
from ohmward_lab.simulate.mujoco_plant import RlmaParameters, RlmaPlant
from ohmward_lab.simulate.robot_sensors import RobotTruth
from ohmward_lab.traction.compared_slip_laws import FuzzySlidingMode, SlipPid, SlipRatioSlidingMode
from ohmward_lab.traction.wheel_speed_cascade import WheelSpeedDrive
from slip_cases import case_rows
from slip_loops import (
    COASTED_DOWN,
    DRAG,
    DT,
    LIMITS,
    SLIDING,
    UNSURE,
    WHEEL,
    WIDER,
    Sensors,
    Stepper,
    Torque,
    Tracking,
    cascade,
    lasting,
    observed_run,
    run,
    tracking,
    with_controller,
)
from slip_peers import claim_figures, claim_rows, compared_figures, compared_rows

TARGET = 0.12
FRICTIONS = (0.2, 0.8)
SEEDS = range(100, 105)
LAWS = {
    "sliding mode on slip speed": SLIDING,
    "the same, wider": WIDER,
    "fuzzy gain and layer": FuzzySlidingMode(SLIDING),
    "PID on the slip ratio": SlipPid(),
    "sliding mode on the slip ratio ([T] 5.3)": SlipRatioSlidingMode(UNSURE),
}
SENSORS = {
    "driven encoders, currents, IMU": Sensors(),
    "the same, 2048 counts": Sensors(counts=2048),
    "the same, 16384 counts": Sensors(counts=16384),
    "the same, mass believed 3 % more": Sensors(mass=1.03),
    "the same, accelerometer shows 1 % more": Sensors(scale=1.01),
    "and encoders on the passive wheels": Sensors(passive=True),
    "time of edges: driven encoders, currents, IMU": Sensors(edges=True),
    "time of edges: the same, 1024 counts": Sensors(counts=1024, edges=True),
    "time of edges: the same, mass believed 3 % more": Sensors(mass=1.03, edges=True),
    "time of edges: and encoders on the passive wheels": Sensors(passive=True, edges=True),
    "driven encoders, currents, pitch": Sensors(imu=False),
    "the same, rolling resistance known": Sensors(imu=False, rolling=COASTED_DOWN),
    "the same and an external speed": Sensors(imu=False, rolling=COASTED_DOWN, speed=True),
    "driven encoders, currents, pitch unknown to 1 deg": Sensors(imu=False, pitch_std_deg=1.0),
}
#: The sensors that have to reach the bars.
BARRED = (
    "driven encoders, currents, IMU",
    "and encoders on the passive wheels",
    "time of edges: driven encoders, currents, IMU",
    "time of edges: and encoders on the passive wheels",
)
#: Of the motors of the energy table.
TORQUE_CONSTANT, RESISTANCE = 0.517, 0.3
DISTANCE_M, SPEED_M_S, RAMP_M_S2 = 5.0, 1.0, 0.5
#: A ramp that eases off all the way, and takes as long as the constant one to the same place.
EASED = {"acceleration_m_s2": 4 / 3 * RAMP_M_S2, "easing_m_s": SPEED_M_S}


def hold(_: float) -> SlipCommand:
    """The command of the tables."""
    return SlipCommand(TARGET)


def with_truth(law: Any, friction: float, **changes: Any) -> Tracking:
    """From rest with the true speed fed back."""
    make = with_controller(SlipController(WHEEL, law, LIMITS, **changes), hold)
    return tracking(run(make, friction, lasting(3.0), DRAG), TARGET, 2.0)


def with_estimate(sensors: Sensors, friction: float) -> list[Tracking]:
    """From rest with the observer's speed and force fed back, once for each seed."""
    controller = SlipController(WHEEL, WIDER, LIMITS)
    ground = [Patch(friction=friction)]
    runs = [
        observed_run(Stepper(controller, hold), RlmaPlant(RlmaParameters(), ground), 1.5, sensors, seed)
        for seed in SEEDS
    ]
    return [tracking(o.truth, TARGET, 0.5) for o in runs]


def rows() -> Iterator[Figure]:
    """The figures that have bars."""
    for friction in FRICTIONS:
        case = f"MuJoCo, friction {friction}, taken for 0.5"
        t = with_truth(SLIDING, friction)
        yield at_most(case, "sliding mode, true speed", "from rest to slip 0.12 [s]", t.settled_s, 0.3)
        for name in BARRED:
            found = with_estimate(SENSORS[name], friction)
            worst = max(t.settled_s for t in found)
            method = f"sliding mode; {name}"
            yield at_most(case, method, "from rest to slip 0.12 [s], worst of 5", worst, 0.3)
            yield at_most(case, method, "RMS of the slip after 0.5 s, worst of 5", max(t.rms for t in found), 0.01)
    yield from compared_figures()
    yield from claim_figures()
    for friction, grade in SCENES:
        trips = all_trips(friction, grade)
        case = f"MuJoCo, friction {friction}, grade {grade} rad, 5 m from rest"
        for quantity, value in shares(trips).items():
            yield at_most(case, "speed with slip bound 0.12", quantity, value, 0.0, "+.2f")


def shares(trips: dict[str, Trip]) -> dict[str, float]:
    """Energy of the bounded speed over the best of the others' [%], as asked and at the same speed at the end."""
    others = [trips[name].J_per_m for name in ("3 N m", "PI, step", "PI, ramp")]
    fair = [*others, trips["PI, ramp, same speed"].J_per_m]
    return {
        "energy over the best baseline [%]": 100 * (trips["bound 0.12"].J_per_m / min(others) - 1),
        "the same, all as fast at the end [%]": 100 * (trips["bound 0.12, ramp's speed"].J_per_m / min(fair) - 1),
    }


def truth_rows() -> Iterator[str]:
    for name, law in LAWS.items():
        for friction in FRICTIONS:
            yield line(name, friction, with_truth(law, friction))
    for friction in FRICTIONS:
        name = "sliding mode on slip speed, floor 0.2 m/s, no launch"
        yield line(name, friction, with_truth(SLIDING, friction, floor_m_s=0.2, launch=1.0))
    for friction in FRICTIONS:
        truth = run(cascade(TARGET), friction, lasting(3.0), DRAG)
        yield line("cascade at 50 Hz on a wheel-speed drive", friction, tracking(truth, TARGET, 2.0))


def line(name: str, friction: float, t: Tracking) -> str:
    settled = f"{t.settled_s:.3f}" if math.isfinite(t.settled_s) else "never"
    return f"| {name} | {friction} | {settled} | {t.rms:.4f} | {t.reversals} | {t.change_Nm:.2f} | {t.adhesion:.3f} |"


def hard_rows() -> Iterator[str]:
    hardships: dict[str, dict[str, Any]] = {
        "controller at 100 Hz": {"every": 10},
        "torque 3 ms late": {"late": 3},
        "torque 6 ms late": {"late": 6},
        "encoders with 0.05 rad/s of noise": {"noise_rad_s": 0.05},
    }
    for hardship, options in hardships.items():
        for name in ("sliding mode on slip speed", "fuzzy gain and layer", "PID on the slip ratio"):
            for friction in FRICTIONS:
                make = with_controller(SlipController(WHEEL, LAWS[name], LIMITS), hold, **options)
                truth = run(make, friction, lasting(3.0), DRAG)
                yield line(f"{hardship}: {name}", friction, tracking(truth, TARGET, 2.0))


def estimate_rows() -> Iterator[str]:
    for name, sensors in SENSORS.items():
        for friction in FRICTIONS:
            found = with_estimate(sensors, friction)
            settled = sorted(t.settled_s for t in found)
            cells = [f"{s:.2f}" if math.isfinite(s) else "never" for s in (settled[2], settled[-1])]
            rms = sorted(t.rms for t in found)
            yield f"| {name} | {friction} | {' | '.join(cells)} | {rms[2]:.4f} | {rms[-1]:.4f} |"


class Trip(NamedTuple):
    """Energy [J/m] at the terminals, time [s] and speed at the end [m/s] of one trip."""

    J_per_m: float
    time_s: float
    end_m_s: float


def trip(make: Callable[[], Torque], friction: float, grade_rad: float) -> Trip:
    """`DISTANCE_M` from rest, at most 30 s."""
    there: Callable[[RobotTruth], bool] = lambda t: t.position_m[0] >= DISTANCE_M or t.time_s > 30.0  # noqa: E731
    truth = run(make, friction, there, RlmaParameters(), grade_rad)
    torque, omega = truth.torque_N_m[1:, :2], 0.5 * (truth.wheel_speed_rad_s[1:, :2] + truth.wheel_speed_rad_s[:-1, :2])
    energy_J = float(np.sum(torque * omega + RESISTANCE * (torque / TORQUE_CONSTANT) ** 2)) * DT
    return Trip(energy_J / float(truth.position_m[-1, 0]), float(truth.time_s[-1]), float(truth.speed_m_s[-1]))


def wheel_speed_loop(speed_m_s: float, ramp_m_s2: float) -> Callable[[], Torque]:
    """A wheel-speed PI that knows nothing of slip."""

    def make() -> Torque:
        drive = WheelSpeedDrive(LIMITS)
        state = drive.init(np.zeros(2))

        def torque(truth: RobotTruth) -> Any:
            nonlocal state
            reference = min(speed_m_s, ramp_m_s2 * truth.time_s) / WHEEL.radius_m
            state, given = drive.step(state, reference, truth.wheel_speed_rad_s[:2], DT)
            return given

        return torque

    return make


def bounded(speed_m_s: float, slip_bound: float) -> Callable[[], Torque]:
    """The speed loop within its slip bound, on the true speed."""
    loop = SpeedController(WHEEL, SLIDING, LIMITS, **EASED)
    return with_controller(loop, lambda _: SpeedCommand(speed_m_s, slip_bound))


SCENES = tuple((friction, grade) for friction in FRICTIONS for grade in (0.0, 0.05))


def all_trips(friction: float, grade_rad: float) -> dict[str, Trip]:
    """By the name of the controller."""

    def go(make: Callable[[], Torque]) -> Trip:
        return trip(make, friction, grade_rad)

    ramp, ours = go(wheel_speed_loop(SPEED_M_S, RAMP_M_S2)), go(bounded(SPEED_M_S, 0.12))
    return {
        "3 N m": go(lambda: lambda _: 3.0),
        "PI, step": go(wheel_speed_loop(SPEED_M_S, math.inf)),
        "PI, ramp": ramp,
        "PI, ramp, same speed": go(wheel_speed_loop(SPEED_M_S * ours.end_m_s / ramp.end_m_s, RAMP_M_S2)),
        "bound 0.12": ours,
        "bound 0.12, ramp's speed": go(bounded(ramp.end_m_s, 0.12)),
        "bound 0.06": go(bounded(SPEED_M_S, 0.06)),
    }


def energy_rows() -> Iterator[str]:
    for friction, grade in SCENES:
        trips = all_trips(friction, grade)
        cells = " | ".join(f"{t.J_per_m:.2f}, {t.time_s:.2f} s, {t.end_m_s:.3f}" for t in trips.values())
        plain, fair = shares(trips).values()
        yield f"| {friction}, {grade} | {cells} | {plain:+.2f} % | {fair:+.2f} % |"


def page() -> str:
    head = "| | friction | settled [s] | RMS | reversals | change [N m] | adhesion |\n|---|---|---|---|---|---|---|"
    return "\n".join([
        "# Slip control",
        "",
        "Written by `make slip-control`: RLMA in MuJoCo, torque at 1 kHz, friction taken for 0.5.",
        "",
        "## From rest to slip 0.12, true speed fed back",
        "",
        "Settled: within 0.02 for good. RMS after 2 s. Reversals: how often the torque turned back by more than 0.1 N",
        "m in the first half second. Change: largest from step to step, after the first. Adhesion: most of the load",
        "that the ground gave in the first half second. Drag of 32 v^2.",
        "",
        head,
        *truth_rows(),
        "",
        "## The same under hardships",
        "",
        head,
        *hard_rows(),
        "",
        "## The same with an estimated speed",
        "",
        "`MomentumObserver` at 1 kHz after a second at rest, 4096 counts where nothing else is said; law: the wider",
        "one. Every sensor is noisy, `slip_loops.Sensors` says how much. No drag. Five runs each; RMS after 0.5 s.",
        "",
        "| sensors | friction | settled [s], median | worst | RMS, median | worst |",
        "|---|---|---|---|---|---|",
        *estimate_rows(),
        "",
        "## Beside a plain PI tuned at one friction, from rest and out of a spin",
        "",
        "Slip 0.12 on the observer's estimate, after a rest or after 0.6 s at 12 N m: time after which the slip stays",
        "within 0.02, and RMS of the torque's change from step to step [mN m]; worst of two runs. Least: the time in",
        "which the full torque ends the spin. The PI on the slip ratio was tuned from rest at friction 0.5: of nine",
        "pairs of gains [N m, N m/s] the one with the least settling time times change of torque. The falling tyre is",
        "Burckhardt's wet asphalt, scaled to the friction, in our own plant.",
        "",
        "| from | sensors | ground | friction | least [s] | slip law [s] | [mN m] | PI [s] | [mN m] | gains |",
        "|---|---|---|---|---|---|---|---|---|---|",
        *compared_rows(),
        "",
        "## The claim of the observer",
        "",
        "`MomentumObserver` in MuJoCo: friction 0.15 to 1.0, mass 0.7 to 1.3 of what is believed, grade -0.1 to 0.1,",
        "straight and turning, torques that jump every quarter of a second; 24 drives of 2 s.",
        "",
        "| sensors | NEES of the speed | in its 95 % band | RMSE [mm/s] |",
        "|---|---|---|---|",
        *claim_rows(),
        "",
        "## Two drives of [T]",
        "",
        "RMS of the true slip's error while braking above 0.25 m/s and, in case II, while driving from 1 s to 6 s;",
        "and of the torque's change from step to step. The same law, once on the observer, once on counts over 10 ms.",
        "",
        "| case | slip from | RMS driving | RMS braking | change of torque, RMS [N m] |",
        "|---|---|---|---|---|",
        *case_rows(),
        "",
        f"## Energy over {DISTANCE_M:g} m from rest, {SPEED_M_S:g} m/s",
        "",
        "J/m at the terminals of the motors (0.517 N m/A, 0.3 ohm), what braking gives back counted; time; speed at",
        "the end. Wheel-speed loops end slower than asked by their slip; `ramp, same speed` asks for so much more",
        "that it does not, `ramp's speed` for so much less. The speed loops with slip bound ease off over a ramp that",
        "takes as long as the constant one. Last columns: bound 0.12 against the best of the first three, and with",
        "the speed of the ramp at the end against the best of all four others.",
        "",
        f"| friction, grade [rad] | {' | '.join(TRIP_NAMES)} | | same speed |",
        "|---" * (len(TRIP_NAMES) + 3) + "|",
        *energy_rows(),
        "",
    ])  # fmt: skip


TRIP_NAMES = (
    "3 N m",
    "PI, step",
    "PI, ramp",
    "PI, ramp, same speed",
    "bound 0.12",
    "bound 0.12, ramp's speed",
    "bound 0.06",
)


if __name__ == "__main__":
    (HERE / "slip_control.md").write_text(page(), encoding="utf-8")
