"""Simulated robot in closed loop, in real time: what `ohmward run --demo` shows with nothing attached."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ohmward.checks import require_positive
from ohmward.lab import lab
from ohmward.onboard.message import Put


@dataclass(frozen=True)
class SimulationSource:
    """Samples of a simulated drive."""

    live: ClassVar[bool] = False
    #: path of a scenario file or name of a packaged one (`ohmward simulate --list`); default: a robot on a loop for
    #: some hours
    scenario: str | None = None
    rate: float = 1.0  #: seconds of the drive per second, > 0; limited by the speed of the machine
    seed: int = 1  #: seed of the sensor noise
    name: str = "simulation"  #: in diagnostics

    def __post_init__(self) -> None:
        require_positive("rate", self.rate)

    async def run(self, put: Put) -> None:
        """Drive to the end of the scenario, or until the battery is empty."""
        await lab("onboard.simulated_robot").run(self, put)

    async def drive(self, put: Put, torque_Nm: Callable[[Sequence[str]], np.ndarray]) -> None:
        """Stand on the scenario's ground, and drive with these torques until the battery is empty, in real time.

        torque_Nm: gives the driven wheels' torques now, by their names.  One acts from the next sample on, as on a bus.
        """
        await lab("onboard.simulated_robot").drive(self, put, torque_Nm)
