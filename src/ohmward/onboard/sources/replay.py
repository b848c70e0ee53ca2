"""Replay of a recorded log, in real time or faster."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import cast, get_args

import numpy as np

from ohmward.checks import require_one_of, require_positive
from ohmward.logs.drive_log import DriveLog, read_drive
from ohmward.logs.log import Log, read_log
from ohmward.logs.sign import CurrentSign
from ohmward.onboard.message import Message, Put
from ohmward.onboard.part import EndedError
from ohmward.traction.robot.file import load_robot

#: Columns of a log and the signals that they are.
_OF_BATTERY = {
    "current_A": "battery_current_A",
    "voltage_V": "battery_voltage_V",
    "temperature_degC": "battery_temperature_degC",
}
_OF_BODY = ("yaw_rate_rad_s", "acceleration_m_s2", "pitch_rad", "speed_m_s", "speed_std_m_s", "speed_age_s")


@dataclass(frozen=True)
class ReplaySource:
    """Samples of a log, as they came.

    Attributes:
        path: of the log: of a battery, or with `robot` of a drive.
        robot: path of a robot file or name of a packaged robot, for logs of drives.
        current_sign: what a positive current of a log of a battery does, "charge" or "discharge"; "auto" lets the data
            tell.
        rate: seconds of the log in a second, > 0; inf replays as fast as it can.
        name: in diagnostics.
    """

    path: str
    robot: str | None = None
    current_sign: str = "auto"
    rate: float = 1.0
    name: str = "replay"

    def __post_init__(self) -> None:
        require_one_of("current_sign", self.current_sign, get_args(CurrentSign))
        if self.rate != math.inf:
            require_positive("rate", self.rate)

    async def run(self, put: Put) -> None:
        """Put every sample at its time; it is received on the log's clock, so that a faster replay gives the same."""
        log = await asyncio.to_thread(self._read)
        samples = _of_drive(log) if isinstance(log, DriveLog) else _of_battery(log)
        began_s, first_s = time.monotonic(), float(log.time_s[0])
        for stamp_s, values in samples:
            wait_s = (stamp_s - first_s) / self.rate - (time.monotonic() - began_s)
            await asyncio.sleep(max(wait_s, 0.0))
            put(Message(stamp_s, began_s + stamp_s - first_s, self.name, values))
        raise EndedError(f"{self.path} was replayed to its end")

    def _read(self) -> Log | DriveLog:
        return (
            read_drive(self.path, load_robot(self.robot))
            if self.robot
            else read_log(self.path, current_sign=cast(CurrentSign, self.current_sign))
        )


def _of_battery(log: Log) -> Iterator[tuple[float, dict[str, float]]]:
    """Time and values of every sample of a battery."""
    columns = {signal: getattr(log, name) for name, signal in _OF_BATTERY.items() if getattr(log, name) is not None}
    return _rows(log.time_s, columns)


def _of_drive(log: DriveLog) -> Iterator[tuple[float, dict[str, float]]]:
    """Time and values of every sample of a drive."""
    columns = {f"wheel_speed_rad_s.{k}": column for k, column in enumerate(log.wheel_speed_rad_s.T)}
    columns |= {f"motor_current_A.{k}": column for k, column in enumerate(log.motor_current_A.T)}
    columns |= {name: values for name in _OF_BODY if (values := getattr(log, name)) is not None}
    return _rows(log.time_s, columns)


def _rows(time_s: np.ndarray, columns: dict[str, np.ndarray]) -> Iterator[tuple[float, dict[str, float]]]:
    for stamp_s, *row in zip(time_s.tolist(), *(column.tolist() for column in columns.values()), strict=True):
        yield stamp_s, dict(zip(columns, row, strict=True))
