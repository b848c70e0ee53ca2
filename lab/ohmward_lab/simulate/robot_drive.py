"""The drive home at the end of the robot day, for `ohmward demo` and tests: dry floor, wet tiles, a ramp."""

from __future__ import annotations

from ohmward_lab.simulate.closed_loop import Command, Control, ExternalSpeed, Grade, Pack, Patch, Scenario, Sensing

#: The rest of the way: a plan for `ohmward mission`.
WAY_HOME = """\
# The rest of the way home. Units are part of the names; legs are driven in this order.
format = "ohmward-plan/1"
reserve_soc = 0.1      # state of charge that must be left at the end

[[leg]]
distance_m = 2500.0
terrain = "floor"      # what a metre costs there was learned on the drive so far
speed_m_s = 0.8
stop_s = 60.0          # at a gate

[[leg]]
distance_m = 500.0
terrain = "floor"
speed_m_s = 0.6
grade_rad = 0.03       # uphill

[[leg]]
distance_m = 1500.0
terrain = "floor"
speed_m_s = 0.8
"""
_HARD_FLOOR = 0.02
_DRY, _WET = 0.8, 0.1


def robot_drive(chemistry: str = "lfp", start_soc: float = 0.4, seed: int = 1, plant: str = "own") -> Scenario:
    """RLMA sets out, stops on wet tiles, starts on them again and climbs a ramp: half a minute, in closed loop.

    chemistry: "lfp" or "lead-acid".  start_soc: state of charge at the end of the day.  seed: draws the sensors' noise.
    plant: "own" or "mujoco".

    Raises:
        InputError: as `Scenario`.
    """
    speeds_m_s = {0.0: 0.8, 7.0: 0.0, 9.0: 0.8, 24.0: 0.4, 28.0: 0.0}
    return Scenario(
        name="the drive home",
        duration_s=30.0,
        commands=tuple(Command(from_s, speed_m_s=speed) for from_s, speed in speeds_m_s.items()),
        robot="rlma",
        plant=plant,
        battery=Pack(chemistry, start_soc),
        ground=(
            Patch(friction=_DRY, rolling=_HARD_FLOOR),
            Patch(friction=_WET, rolling=_HARD_FLOOR, from_m=4.0, to_m=6.5),
        ),
        grade=Grade((7.0, 8.0, 13.0, 14.0), (0.0, 0.06, 0.06, 0.0)),
        sensors=Sensing(
            interval_s=0.02, encoders="all", pitch=True, speed=ExternalSpeed(interval_s=0.1, std_m_s=0.03, delay_s=0.05)
        ),
        controller=Control(slip_bound=0.3, acceleration_m_s2=0.8, interval_s=0.002),
        seed=seed,
    )
