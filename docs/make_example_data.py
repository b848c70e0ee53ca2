"""Make the recordings of `ohmward_lab.examples`, on which the notebooks run: `python docs/make_example_data.py`.

All of them are simulated, by models that are not ours: cells of porous electrodes by PyBaMM, with the sensors of a
robot. The recording of ROS is of a robot of two wheels that rolls, is held by a door sill, and rolls on; its motion is
an exact integral. Numbers are rounded to what such sensors resolve, so that the files are small. They need the extras
`cells` and `ros`, and some minutes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from ohmward.logs import Log, write_log
from ohmward.traction import load_robot
from ohmward_lab.examples import FOLDER
from ohmward_lab.simulate.electrochemical import (
    ElectrochemicalCell,
    aged,
    capacity_Ah,
    log_of,
    record_cell,
    simulate_cell,
    usual_sensors,
)
from ohmward_lab.simulate.mission import DayPlan, working_day

#: Monday, 2026-03-02, 08:00 UTC.
MONDAY_S, DAY_S = 1_772_438_400.0, 86_400.0


def main() -> None:
    """Write every recording."""
    FOLDER.mkdir(exist_ok=True)
    cell = ElectrochemicalCell("OKane2022")
    for record, degC in (("pulse-test", 25.0), ("day", 25.0), ("day", 10.0)):
        name = "lg-m50-" + (record if record == "pulse-test" else f"drive-{degC:.0f}degC")
        every = 1 if record == "pulse-test" else 2
        write(name, small(record_cell(cell, record, degC, seed=int(degC)), every))
    for robot, pack, days in robots():
        for k in range(days):
            log = record_cell(pack, "day", 18.0, seed=10 * robot + k, new_Ah=4.5)
            write(f"amr-{robot}_2026-03-0{2 + k}", small(replace(log, start_unix_s=MONDAY_S + k * DAY_S), 10))
    write("pack-with-a-weak-cell", weak_pack())
    write_bag(FOLDER / "turtlebot4")
    print(f"{sum(file.stat().st_size for file in FOLDER.rglob('*') if file.is_file()) / 1024:.0f} KB in {FOLDER}")


def robots() -> Iterator[tuple[int, ElectrochemicalCell, int]]:
    """Robots of a fleet with four NMC cells in series: number, battery, and days recorded."""
    new = ElectrochemicalCell("OKane2022", n_series=4)
    yield 1, new, 5
    yield 2, aged(new, 0.82, 1.4), 2
    yield 3, aged(new, 0.95, 1.1), 2


def small(log: Log, every: int) -> Log:
    """Means over every so many samples of a log, as a slower logger writes, rounded to what its sensors resolve."""

    def mean(values: np.ndarray, decimals: int) -> np.ndarray:
        whole = values[: len(values) // every * every]
        return np.round(whole.reshape(-1, every).mean(axis=1), decimals)

    assert log.temperature_degC is not None
    return replace(
        log,
        time_s=mean(log.time_s, 2),
        current_A=mean(log.current_A, 3),
        voltage_V=mean(log.voltage_V, 3),
        temperature_degC=mean(log.temperature_degC, 1),
        extra={name: mean(values, 4 if name == "soc_true" else 3) for name, values in log.extra.items()},
    )


def weak_pack() -> Log:
    """A day of four LFP cells in series, the third of which has lost a fifth of its capacity."""
    rng = np.random.default_rng(7)
    new = ElectrochemicalCell("Prada2013")
    cells = [new, aged(new, 0.99), aged(new, 0.8, 1.4), aged(new, 0.98)]
    C = capacity_Ah(new)
    load = working_day(rng, C, DayPlan(20.0))
    time_s = np.arange(0.0, load.time_s[-1], 2.0)
    logs = [log_of(simulate_cell(cell, load, time_s), usual_sensors(C), rng, "cell") for cell in cells]
    voltages = {f"cell_{k + 1}_voltage_V": log.voltage_V for k, log in enumerate(logs)}
    log = replace(logs[0], voltage_V=sum(voltages.values()), extra=voltages, start_unix_s=MONDAY_S)
    return small(log, 2)


def write(name: str, log: Log) -> None:
    """Write a log as Parquet, without its notes."""
    write_log(log, FOLDER / f"{name}.parquet")
    print(f"{name}: {len(log):,} samples, {(FOLDER / f'{name}.parquet').stat().st_size / 1024:.0f} KB")


#: Interval of wheels and gyro, of the battery, duration [s]; the robot is held from 60 s to 68 s.
STEP_S, BATTERY_S, DURATION_S, HELD_S = 0.05, 1.0, 120.0, (60.0, 68.0)
#: What the gyro reads at rest [rad/s], and its noise.
GYRO_OFFSET, GYRO_STD = 0.004, 0.002


def write_bag(path: Path) -> None:
    """A recording of ROS 2: wheel angles, gyro, battery of a TurtleBot 4 that drives rounds of a room."""
    rng, robot = np.random.default_rng(4), load_robot("turtlebot4")
    time_s = np.arange(0.0, DURATION_S, STEP_S)
    moving = (time_s > 5.0) & (time_s < 112.0)
    speed = 0.25 * moving
    yaw_rate = np.where(moving & (time_s % 20.0 > 15.0), np.pi / 10.0, 0.0)
    held = (time_s >= HELD_S[0]) & (time_s < HELD_S[1])
    half_track = 0.5 * float(np.ptp([place.y_m for place in robot.places[: robot.driven]]))
    rims = speed[:, None] + yaw_rate[:, None] * half_track * np.array([-1.0, 1.0])
    angles = np.cumsum(rims / robot.wheel.radius_m * STEP_S, axis=0)
    true_yaw_rate = np.where(held, 0.0, yaw_rate)
    gyro = true_yaw_rate + GYRO_OFFSET + GYRO_STD * rng.standard_normal(time_s.size)
    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = {topic: f"sensor_msgs/msg/{kind}" for topic, kind in TOPICS.items()}
    writer = Writer(path, version=8, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        topics = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()}
        for k, t in enumerate(time_s):
            messages = {"/joint_states": joints(store, t, angles[k]), "/imu": imu(store, t, gyro[k])}
            if k % round(BATTERY_S / STEP_S) == 0:
                messages["/battery_state"] = battery(store, t, -0.9 - 1.3 * float(moving[k]), rng)
            for topic, message in messages.items():
                writer.write(topics[topic], nanoseconds(t), store.serialize_cdr(message, kinds[topic]))
    print(f"{path.name}: {sum(file.stat().st_size for file in path.iterdir()) / 1024:.0f} KB")


TOPICS = {"/joint_states": "JointState", "/imu": "Imu", "/battery_state": "BatteryState"}


def nanoseconds(time_s: float) -> int:
    """Unix time of a time since the start."""
    return round((MONDAY_S + time_s) * 1e9)


def header(store: Any, time_s: float, frame: str) -> Any:
    """The head of a message."""
    stamp = nanoseconds(time_s)
    time = store.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return store.types["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def joints(store: Any, time_s: float, angles: np.ndarray) -> Any:
    """Wheel angles as 508.8 counts a turn, the encoders of a Create 3."""
    count = 2 * np.pi / 508.8
    return store.types["sensor_msgs/msg/JointState"](
        header=header(store, time_s, "base_link"),
        name=["left_wheel_joint", "right_wheel_joint"],
        position=np.floor(angles / count) * count,
        velocity=np.zeros(0),
        effort=np.zeros(0),
    )


def imu(store: Any, time_s: float, yaw_rate: float) -> Any:
    """Rate of turn on level ground; the orientation is not known."""
    types = store.types
    vector, turn = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    unknown = np.full(9, 0.0)
    unknown[0] = -1.0
    return types["sensor_msgs/msg/Imu"](
        header=header(store, time_s, "imu_link"),
        orientation=turn(x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=unknown,
        angular_velocity=vector(x=0.0, y=0.0, z=round(float(yaw_rate), 5)),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(x=0.0, y=0.0, z=9.81),
        linear_acceleration_covariance=np.zeros(9),
    )


def battery(store: Any, time_s: float, current_A: float, rng: np.random.Generator) -> Any:
    """Four lithium cells of 1.8 Ah."""
    current = current_A + 0.02 * rng.standard_normal()
    return store.types["sensor_msgs/msg/BatteryState"](
        header=header(store, time_s, "base_link"),
        voltage=round(15.4 + 0.12 * current - 2e-5 * time_s, 3),
        temperature=27.0,
        current=round(current, 3),
        charge=np.nan,
        capacity=np.nan,
        design_capacity=1.8,
        percentage=np.nan,
        power_supply_status=2,
        power_supply_health=1,
        power_supply_technology=2,
        present=True,
        cell_voltage=np.zeros(0, np.float32),
        cell_temperature=np.zeros(0, np.float32),
        location="",
        serial_number="",
    )


if __name__ == "__main__":
    main()
