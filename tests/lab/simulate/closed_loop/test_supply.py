from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.models.thevenin import CircuitInput
from ohmward.errors import InputError
from ohmward.traction import RLMA
from ohmward_lab.simulate.closed_loop.supply import (
    ElectricalLoad,
    Pack,
    Supply,
    affordable_share,
    available_torque,
    current_for_power,
    step,
)
from ohmward_lab.simulate.plant import heat, resting_state
from simulate.examples import simple_battery


@pytest.mark.parametrize("kind", ["lfp", "lead-acid", "lipo"])
@pytest.mark.parametrize("power_W", [0.0, 20.0, 300.0, -80.0])
def test_voltage_times_current_is_the_power_asked_for(kind, power_W):
    supply = Supply(Pack(kind, start_soc=0.5))
    for _ in range(100):
        now = supply.draw(power_W, 0.01)
        assert -now.voltage_V * now.current_A == pytest.approx(power_W, rel=1e-12, abs=1e-12)
        assert now.power_W == pytest.approx(power_W, rel=1e-12, abs=1e-12)


def test_the_current_solves_the_quadratic_of_a_plain_resistance():
    battery = simple_battery(transfer_V=0.0)
    state = resting_state(battery, 0.5)
    U, R, P = 12.5, 0.02, 400.0
    expected = (-U + np.sqrt(U * U - 4 * R * P)) / (2 * R)
    assert current_for_power(P, state.x, 25.0, battery) == pytest.approx(expected, rel=1e-12)


def test_the_charge_that_flows_is_the_charge_that_is_missing():
    supply = Supply(Pack("lfp", start_soc=0.8))
    drawn_As = 0.0
    for _ in range(1000):
        drawn_As -= supply.draw(150.0, 0.01).current_A * 0.01
    assert 0.8 - supply.now.soc == pytest.approx(drawn_As / supply.battery.circuit.capacity_As, rel=1e-9)


def test_the_largest_power_ends_at_the_lowest_voltage():
    supply = Supply(Pack("lead-acid", start_soc=0.6))
    now = supply.draw(supply.now.available_W, 1e-4)
    assert now.voltage_V == pytest.approx(supply.battery.voltage_min_V, rel=1e-6)


def test_a_full_battery_takes_back_no_more_than_its_charger_would():
    supply = Supply(Pack("lfp", start_soc=0.999))
    now = supply.draw(-5000.0, 1e-3)
    assert now.voltage_V == pytest.approx(supply.battery.voltage_max_V, rel=1e-6)
    assert -500.0 < now.power_W < 0.0


def test_a_charge_transfer_of_the_circuit_bends_the_current_too():
    battery = simple_battery(transfer_V=0.0)
    battery = replace(battery, circuit=replace(battery.circuit, transfer_V=0.05))
    _, now = step(resting_state(battery, 0.5), ElectricalLoad(1e-3, 400.0, 25.0), battery)
    assert now.power_W == pytest.approx(400.0, rel=1e-5)
    assert now.voltage_V > 12.5 - 0.02 * -now.current_A + 0.1


def test_losses_warm_the_battery():
    battery = simple_battery()
    state, now = step(resting_state(battery, 0.5), ElectricalLoad(1.0, 400.0, 25.0), battery)
    assert state.heat_J == pytest.approx(heat(state.x, CircuitInput(now.current_A, 25.0), battery))
    assert now.temperature_degC == pytest.approx(25.0 + state.heat_J / battery.heat_capacity_J_per_K, rel=1e-3)


@pytest.mark.parametrize(
    "values, message",
    [
        ({"kind": "nuclear"}, "battery.kind must be one of lfp, lead-acid, lipo, got 'nuclear'"),
        ({"kind": "lfp", "file": "b.toml"}, "battery.kind = 'lfp' and battery.file = 'b.toml' are two batteries"),
        ({"start_soc": 80.0}, "battery.start_soc must be > 0 and at most 1 \\(0.8 is 80 %\\), got 80"),
        ({"temperature_degC": 300.0}, "battery.temperature_degC must be between"),
    ],
)
def test_impossible_packs_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        Pack(**values)


def full_supply():
    return Supply(Pack("lfp", start_soc=0.9)).now


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["forward", "back"])
def test_the_voltage_limits_the_current_of_a_fast_wheel(sign):
    motor, now = RLMA.motor, full_supply()
    omega = np.full(2, sign * 0.9 * now.voltage_V / motor.wheel_constant_Nm_per_A)
    torque = sign * available_torque(sign * np.array([50.0, -1.0]), omega, RLMA, now)
    assert torque[0] == pytest.approx(motor.wheel_constant_Nm_per_A * 0.1 * now.voltage_V / motor.resistance_ohm)
    assert torque[1] == -1.0


def test_the_power_limits_all_motors_in_proportion():
    robot, now = replace(RLMA, idle_W=20.0), full_supply()._replace(available_W=120.0)
    asked, omega = np.array([10.0, 5.0]), np.array([4.0, 4.0])
    torque = available_torque(asked, omega, robot, now)
    current = torque / robot.motor.wheel_constant_Nm_per_A
    assert torque[0] / torque[1] == pytest.approx(2.0)
    assert robot.motor.resistance_ohm * current @ current + torque @ omega == pytest.approx(100.0)


def test_what_the_battery_can_feed_is_left_alone():
    asked = np.array([3.0, -2.0])
    assert available_torque(asked, np.array([2.0, 2.0]), RLMA, full_supply()) == pytest.approx(asked, rel=1e-15)


@pytest.mark.parametrize("heat_W, moving_W, most_W", [(100.0, 50.0, 60.0), (100.0, -50.0, 20.0), (5.0, 90.0, 1.0)])
def test_the_share_meets_the_limit(heat_W, moving_W, most_W):
    share = affordable_share(heat_W, moving_W, most_W)
    assert 0 < share < 1
    assert heat_W * share**2 + moving_W * share == pytest.approx(most_W)


def test_nothing_left_means_no_torque():
    assert affordable_share(10.0, 10.0, 0.0) == 0.0
