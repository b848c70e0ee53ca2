"""A simulated battery as a power supply: current and voltage under a load, their sensors, and the torque it can feed.

V(i) i = -P,   V(i) = U + v_0(i) + B arcsinh(i / i_x)         U: without current, i > 0 charges, P > 0 is drawn

The voltage is that at the beginning of a step and the current is constant in it, so the energy V i dt at the terminals
is exact.

The voltage limits each motor's current, the power all of them together:

|R I + n K_m omega| <= V      and      sum (R I^2 + n K_m omega I) <= P_most - P_idle
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.file import load_battery
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.checks import require_between, require_one_of
from ohmward.errors import InputError
from ohmward.trace import Kernel, maximum, where
from ohmward.traction.robot.robot import Robot
from ohmward_lab.simulate import plant
from ohmward_lab.simulate.cells import BATTERIES, SimulatedBattery, lithium_polymer_pack, of_battery_file
from ohmward_lab.simulate.sensors import Sensor

#: Newton starts near the root and converges quadratically: five steps reach rounding.
_POWER_STEPS = 5

#: Simulated batteries by name: LFP and lead-acid of 12 V and 12 Ah, and the 37 V, 8 Ah of [T].
KINDS: Mapping[str, SimulatedBattery] = {
    "lfp": BATTERIES["lfp"],
    "lead-acid": BATTERIES["lead-acid"],
    "lipo": lithium_polymer_pack(),
}

#: A Hall sensor and a voltage divider.
PACK_CURRENT = Sensor(low=-150.0, high=150.0, resolution=0.012, noise_std=0.02, offset=0.02)
PACK_VOLTAGE = Sensor(low=0.0, high=1000.0, resolution=0.004, noise_std=0.004)


@dataclass(frozen=True)
class Pack:
    """Battery of a scenario, and its state at the start."""

    kind: str | None = None  #: one of `KINDS`; None is "lfp", or the battery of `file`
    start_soc: float = 0.8  #: in (0, 1]
    temperature_degC: float = ROOM_DEGC  #: of the battery at the start, and of the air
    file: str | None = None  #: battery file (.toml) instead of a kind

    def __post_init__(self) -> None:
        if self.kind is not None:
            require_one_of("battery.kind", self.kind, tuple(KINDS))
        if self.kind is not None and self.file is not None:
            raise InputError(
                f"battery.kind = {self.kind!r} and battery.file = {self.file!r} are two batteries; leave one out"
            )
        if not 0 < self.start_soc <= 1:
            raise InputError(f"battery.start_soc must be > 0 and at most 1 (0.8 is 80 %), got {self.start_soc:g}")
        require_between("battery.temperature_degC", self.temperature_degC, -30.0, 60.0)
        _ = self.battery

    @cached_property
    def battery(self) -> SimulatedBattery:
        """The battery itself.

        Raises:
            InputError: a file that cannot be read or is no battery file.
        """
        if self.file is None:
            return KINDS[self.kind or "lfp"]
        if not self.file.endswith(".toml"):
            raise InputError(f"battery.file must be a battery file (.toml), got {self.file!r}")
        return of_battery_file(load_battery(self.file))


class ElectricalLoad(NamedTuple):
    """One step: its length [s], the power drawn in it [W], < 0 where it is given back, the temperature of the air."""

    dt_s: Any
    power_W: Any
    ambient_degC: Any


class Supplied(NamedTuple):
    """Current, voltage and power of the battery in a step, and its state after it."""

    current_A: Any  #: > 0 charges
    voltage_V: Any  #: at the terminals
    power_W: Any  #: drawn; more than the load where the battery does not take all of the braking power
    soc: Any  #: state of charge after the step
    temperature_degC: Any  #: after it
    available_W: Any  #: largest power that can be drawn next without going below the lowest voltage


class Supply:
    """A battery under a load, step by step."""

    def __init__(self, pack: Pack) -> None:
        self.battery, self.ambient_degC = pack.battery, pack.temperature_degC
        self.state = plant.resting_state(self.battery, pack.start_soc, pack.temperature_degC)
        self._step = Kernel(step, self.state, ElectricalLoad(0.0, 0.0, 0.0), constants=(self.battery,))
        self.now: Supplied = self._step(self.state, ElectricalLoad(0.0, 0.0, self.ambient_degC))[1]

    def draw(self, power_W: float, dt_s: float) -> Supplied:
        """Draw this power for `dt_s`."""
        self.state, self.now = self._step(self.state, ElectricalLoad(dt_s, power_W, self.ambient_degC))
        return self.now


class PackSensors:
    """Current and voltage of a battery, averaged between two samples.

    Args:
        first: output of the battery before the first step.
        rng: draws the noise.
    """

    def __init__(self, first: Supplied, rng: np.random.Generator) -> None:
        self._rng = rng
        self._sum, self._count = np.zeros(2), 0
        self.add_step(first)

    def add_step(self, supplied: Supplied) -> None:
        """Add one step of the battery to the mean."""
        self._sum = self._sum + np.array([supplied.current_A, supplied.voltage_V])
        self._count += 1

    def sample(self) -> tuple[float, float]:
        """Measured mean current [A] and voltage [V] since the last sample; at least one step must lie between."""
        mean = self._sum / self._count
        self._sum, self._count = np.zeros(2), 0
        now = np.zeros(1)
        current_A = PACK_CURRENT.measure(mean[:1], now, self._rng)
        voltage_V = PACK_VOLTAGE.measure(mean[1:], now, self._rng)
        return float(current_A[0]), float(voltage_V[0])


def step(state: plant.PlantState, load: ElectricalLoad, battery: SimulatedBattery) -> tuple[plant.PlantState, Supplied]:
    """State after a step of constant power, and the battery's output."""
    x, T = state.x, state.temperature_degC
    drawn_W = maximum(load.power_W, -largest_power(x, T, 1.0, battery))
    current_A = current_for_power(drawn_W, x, T, battery)
    u = CircuitInput(current_A, T)
    voltage_V = plant.terminal_voltage(x, u, battery)
    after = plant.next_circuit(x, u, battery, load.dt_s)
    heat_W = plant.heat(after, u, battery)
    T_after = plant.next_temperature(T, heat_W, plant.Demand(load.dt_s, current_A, load.ambient_degC), battery)
    available_W = largest_power(after, T_after, -1.0, battery)
    state = plant.PlantState(after, T_after, current_A, heat_W, state.heat_J + heat_W * load.dt_s)
    return state, Supplied(current_A, voltage_V, -voltage_V * current_A, after[plant.SOC], T_after, available_W)


def current_for_power(power_W: Any, x: np.ndarray, temperature_degC: Any, battery: SimulatedBattery) -> Any:
    """Current [A] with V(i) i = -power_W, by Newton from the current without sag."""
    u = CircuitInput(where(power_W > 0, -1.0, 1.0), temperature_degC)
    U = plant.rest_voltage(x, temperature_degC, battery)
    i = -power_W / U
    for _ in range(_POWER_STEPS):
        drop_V, slope_ohm = plant.instant_drop(i, u, x[plant.SOC], battery)
        V = U + drop_V
        i = i - (V * i + power_W) / (V + slope_ohm * i)
    return i


def largest_power(x: np.ndarray, temperature_degC: Any, direction: float, battery: SimulatedBattery) -> Any:
    """Power [W], >= 0, at the voltage limit of charging (direction 1) or discharging (-1)."""
    limit_V = battery.voltage_max_V if direction > 0 else battery.voltage_min_V
    return limit_V * abs(plant.current_at_limit(x, temperature_degC, direction, battery))


def available_torque(torque_Nm: np.ndarray, omega_rad_s: np.ndarray, robot: Robot, now: Supplied) -> np.ndarray:
    """Torques (driven,) [N m] that the battery can feed, in the demanded proportions where its power limits them.

    torque_Nm: (driven,) demanded.  omega_rad_s: (driven,) speeds of the wheels.
    """
    motor = robot.motor
    back_V = motor.wheel_constant_Nm_per_A * omega_rad_s
    lowest_A = (-now.voltage_V - back_V) / motor.resistance_ohm
    highest_A = (now.voltage_V - back_V) / motor.resistance_ohm
    current = np.clip(torque_Nm / motor.wheel_constant_Nm_per_A, lowest_A, highest_A)
    heat_W = motor.resistance_ohm * float(current @ current)
    moving_W = float(back_V @ current)
    share = affordable_share(heat_W, moving_W, max(now.available_W - robot.idle_W, 0.0))
    return share * motor.wheel_constant_Nm_per_A * current


def affordable_share(heat_W: float, moving_W: float, most_W: float) -> float:
    """The largest share s <= 1 with heat_W s^2 + moving_W s <= most_W."""
    if heat_W + moving_W <= most_W:
        return 1.0
    root = math.sqrt(moving_W * moving_W + 4 * heat_W * most_W)
    return 2 * most_W / (moving_W + root) if moving_W + root > 0 else 0.0
