"""The simulated robot under an operator: armed, driven, and stopped by whatever goes wrong."""

import asyncio
import time
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.assembly import assemble
from ohmward.onboard.control.operator_command import DriveLimits, OperatorCommand
from ohmward.onboard.control.operator_link import OperatorLink
from ohmward.onboard.control.simulated_drives import (
    COMMAND_TIMEOUT_S,
    ConnectedOutput,
    SimulatedDrives,
    connect_simulated_drives,
)
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.onboard.sinks.control import ControlSink
from ohmward.onboard.sources.simulation import SimulationSource
from ohmward.onboard.trial import try_setup
from onboard.control.test_link import cancelled, until
from onboard.servers import free_port

WHEELS = ["left", "right"]
ENABLED = {"enable": 1.0, "torque_Nm.left": 2.0, "torque_Nm.right": 1.0}

SETUP = """
format = "ohmward-setup/1"
robot = "rlma"
[[source]]
kind = "simulation"
[[sink]]
kind = "control"
robot = "rlma"
operator = "127.0.0.1:PORT"
[sink.simulation]
[sink.limits]
estimate_timeout_s = 1.0
operator_timeout_s = 1.0
"""


def test_drives_hold_torques_while_they_are_enabled_and_told_so():
    drives = SimulatedDrives()
    assert not drives.torque_Nm(WHEELS).any()
    drives.take(ENABLED)
    assert drives.torque_Nm(WHEELS).tolist() == [2.0, 1.0]
    drives.take(ENABLED | {"enable": 0.0})
    assert not drives.torque_Nm(WHEELS).any()
    drives.take(ENABLED)
    time.sleep(1.2 * COMMAND_TIMEOUT_S)
    assert not drives.torque_Nm(WHEELS).any()


def test_torques_move_the_robot_and_others_leave_it_at_rest():
    async def last_speeds(torque_Nm):
        speeds: list[float] = []

        def put(message):
            speeds.extend(v for name, v in message.values.items() if name.startswith("wheel_speed"))

        task = asyncio.create_task(SimulationSource().drive(put, lambda wheels: np.full(len(wheels), torque_Nm)))
        await until(lambda: len(speeds) > 200, 30.0)
        await cancelled(task)
        return speeds[-4:]

    assert np.abs(asyncio.run(last_speeds(0.0))).max() < 0.1
    assert np.min(asyncio.run(last_speeds(2.0))) > 1.0
    assert np.max(asyncio.run(last_speeds(-2.0))) < -1.0


@pytest.mark.parametrize("fault", ["the operator stops", "the operator is gone"])
def test_an_operator_drives_the_simulated_robot_and_any_fault_stops_it(tmp_path, monkeypatch, fault):
    monkeypatch.setattr("ohmward.onboard.control.drive_control.SAFE_STOP_S", 10.0)  # a busy machine reaches the usual
    port = free_port()
    setup = replace(SETUP_FILE.parse(SETUP.replace("PORT", str(port))), state=str(tmp_path))

    async def run():
        process = assemble(setup)
        process.estimation.compile()
        running = asyncio.create_task(process.run())
        outputs = [sink.simulation for sink, _ in process.sinks if isinstance(sink, ControlSink)]
        (drives,) = [output.drives for output in outputs if isinstance(output, ConnectedOutput)]

        def speed():
            return process.estimation.state.slip.speed_m_s if process.estimation.state.slip else 0.0

        await until(lambda: process.estimation.state.slip is not None, 30.0)
        link, phases = OperatorLink("127.0.0.1", port, ""), [""]

        async def operate():
            while True:  # a busy machine answers late, which ends a connection
                with suppress(OhmwardError):
                    async for beat in link.beats():
                        phases.append(beat["phase"])

        operating = asyncio.create_task(operate())
        await until(lambda: phases[-1] == "disarmed")
        link.command = OperatorCommand(armed=True)
        await until(lambda: phases[-1] == "armed")
        link.command = OperatorCommand(armed=True, speed_m_s=0.3)
        await until(lambda: drives.torque_Nm(["front_left", "front_right"]).max() > 0.0)
        await until(lambda: speed() > 0.25)
        if fault == "the operator stops":
            link.stop = True
            await until(lambda: phases[-1] == "stopped", 10.0)
        else:
            await cancelled(operating)
            await until(lambda: not drives.torque_Nm(["front_left", "front_right"]).any(), 10.0)
        await until(lambda: abs(speed()) < 0.02)
        assert not drives.torque_Nm(["front_left", "front_right"]).any()
        process.stop()
        await running
        await cancelled(operating)

    asyncio.run(run())


def test_the_check_of_such_a_setup_finds_nothing_wrong(tmp_path):
    setup = replace(SETUP_FILE.parse(SETUP.replace("PORT", str(free_port()))), state=str(tmp_path))
    trial = try_setup(setup, 3.0)
    assert [f for f in trial.findings if f.level.name == "ERROR"] == []


def test_what_cannot_be_connected_is_named():
    robot = SimulationSource(name="robot")

    def control(name, source):
        text = SETUP.replace("PORT", "4720").replace("[sink.simulation]", f'[sink.simulation]\nsource = "{source}"')
        (sink,) = SETUP_FILE.parse(text).sink
        return replace(sink, name=name)

    refused = [
        ([], [control("a", "robot")], 'is no simulated robot; add a .* of kind = "simulation"'),
        ([robot], [control("a", "rover")], "'rover' is no simulated robot; there are: robot"),
        ([robot], [control("a", "robot"), control("b", "robot")], "sink b: 'robot' is driven by another sink already"),
        ([SimulationSource(rate=2.0, name="robot")], [control("a", "robot")], "an operator drives at rate = 1.0"),
    ]
    for sources, sinks, message in refused:
        with pytest.raises(InputError, match=message):
            connect_simulated_drives(sources, sinks)
    with pytest.raises(InputError, match=r"give one way to the drives: .* or \[sink.simulation\]"):
        ControlSink("rlma", limits=DriveLimits())
