"""Assembly of a setup's process: read files, make estimators, resume the saved state, share nodes of ROS."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ohmward.battery.battery import Battery
from ohmward.battery.file import load_battery
from ohmward.battery.models.noise import VOLTAGE_GAIN_STD
from ohmward.energy.consumption_file import load_consumption
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.control.outputs import MqttOutput
from ohmward.onboard.control.simulated_drives import connect_simulated_drives
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.message import no_such_part
from ohmward.onboard.part import LOG, Sink, Source, is_live, sharing
from ohmward.onboard.process import Process
from ohmward.onboard.robot_setup import Setup
from ohmward.onboard.robot_state import Diagnostic, Level
from ohmward.onboard.ros.transport import SharedNode
from ohmward.onboard.sinks import AnySink
from ohmward.onboard.sinks.control import ControlSink
from ohmward.onboard.sinks.mqtt import MqttSink
from ohmward.onboard.sinks.ros2 import Ros2Sink
from ohmward.onboard.sinks.store import StoreSink
from ohmward.onboard.sources.replay import ReplaySource, replays_in_step
from ohmward.onboard.sources.ros2 import Ros2Source
from ohmward.onboard.state_folder import StateFolder
from ohmward.onboard.store.store import DATABASE, totals_of_store
from ohmward.signals.checks import NOT_COUNTED, doubled
from ohmward.trace.kernel import repeatable_lowering
from ohmward.traction.robot.packaged import load_robot
from ohmward.traction.robot.robot import Robot


def on_one_node(
    sources: Sequence[Source], sinks: Sequence[Sink], node: Any = None
) -> tuple[Sequence[Source], Sequence[Sink]]:
    """The sources and sinks of a process; those with the same node, namespace and domain share a node.

    node: existing node of rclpy for all of them.
    """
    nodes: dict[tuple[object, ...], SharedNode] = {}

    def shared(part: Any) -> Any:
        if not isinstance(part, Ros2Source | Ros2Sink) or not (part.uses_rclpy or node is not None):
            return part
        key = () if node is not None else (part.node, part.namespace, part.domain)
        node_of_all = nodes.setdefault(key, SharedNode(part, node))

        async def run(other: Any) -> None:
            async with node_of_all.opened() as transport:
                await part.run_on(transport, other)

        return sharing(part, run)

    return [shared(source) for source in sources], [shared(sink) for sink in sinks]


#: Folder of a robot's state if the setup names none.
STATE = "ohmward-state"


def assemble(setup: Setup, ros_node: Any = None) -> Process:
    """The process of a setup, ready to run.

    ros_node: existing node of rclpy for all sources and sinks of ROS.

    Raises:
        InputError: a file cannot be read, or a control sink names a simulated robot that does not exist.
        OhmwardError: the state folder cannot be used.
    """
    folder = state_folder(setup)
    estimation = estimation_of(setup, folder)
    sources, sinks = connect_simulated_drives(replays_in_step(setup.source), sinks_of(setup))
    parts = on_one_node(sources, sinks, ros_node)
    process = Process(estimation, *parts, strict=setup.strict, alarms=setup.alarms)
    if folder:
        folder.begin(estimation)
        _count_from_store(estimation, setup)
        process.companions.append(("snapshots", folder.writer(estimation, process.now_s)))
    for signal, fault in wiring_faults(setup, estimation.robot):
        if setup.strict:
            raise InputError(f"{signal}: {fault}")
        process.report(Diagnostic(signal, Level.ERROR, fault))
    return process


def _count_from_store(estimation: Estimation, setup: Setup) -> None:
    """Initialise the totals from the robot's store if nothing has been counted yet."""
    store = _store_folder(setup)
    if store is None or any(estimation.totals) or not (Path(store) / DATABASE).exists():
        return
    try:
        capacity_Ah = estimation.battery.capacity_Ah if estimation.battery else math.inf
        estimation.totals = totals_of_store(Path(store), capacity_Ah)
    except OhmwardError as error:
        LOG.warning("totals start from now: %s", error)


def state_folder(setup: Setup) -> StateFolder | None:
    """Folder of the state; None for replays and simulations, which start afresh unless the setup names one.

    Raises:
        OhmwardError: it cannot be used.
    """
    live = not setup.source or any(map(is_live, setup.source))
    if setup.state is None and not live:
        LOG.info("state: nothing is live, so that nothing is kept; to keep it, name a folder: state = ...")
        return None
    consumption = Path(setup.consumption) if setup.consumption else None
    return StateFolder(Path(setup.state or STATE), consumption, setup.learn, live=live)


def sinks_of(setup: Setup) -> list[AnySink]:
    """The sinks of a setup, with the robot's name; a page without a store uses that of the setup's `store` sink.

    The usual name is logged where it leaves this machine: another robot may have it, too.

    Raises:
        InputError: a control sink is of another robot than the setup, or a robot file cannot be read.
    """
    usual = {"robot": Setup.name, "topic": MqttSink.topic, "store": None}
    own = {"robot": setup.name, "topic": f"ohmward/{setup.name}", "store": _store_folder(setup)}
    sinks, shared = [], []
    for sink in setup.sink:
        changed: dict[str, Any] = {key: own[key] for key in usual if getattr(sink, key, "") == usual[key]}
        if isinstance(sink, ControlSink) and sink.mqtt and sink.mqtt.topic == MqttOutput.topic:
            changed["mqtt"] = replace(sink.mqtt, topic=f"{own['topic']}/drives")
        if setup.name == Setup.name and getattr(sink, "identity", "") in changed:
            shared.append(sink.name)
        if isinstance(sink, ControlSink) and setup.robot is not None:
            # the wheels of another robot may have another order
            if sink.robot is not None and load_robot(sink.robot) != load_robot(setup.robot):
                raise InputError(
                    f"sink {sink.name}: robot = {sink.robot!r} is not that of the setup, {setup.robot!r}; leave it out"
                )
            changed["robot"] = setup.robot
        sinks.append(replace(sink, **changed))
    if shared:
        LOG.warning(
            "sink %s: this robot is called %r, as is every robot without a name: two of them would mix; name = ...",
            ", ".join(shared),
            setup.name,
        )
    return sinks


def _store_folder(setup: Setup) -> str | None:
    """Folder of the `store` sink."""
    return next((sink.folder for sink in setup.sink if isinstance(sink, StoreSink)), None)


def wiring_faults(setup: Setup, robot: Robot | None) -> Iterator[tuple[str, str]]:
    """Signals in the setup that cannot be used, and for each a sentence with the fix."""
    first: dict[str, str] = {}
    for source in setup.source:
        for signal in getattr(source, "signals", ()):
            if signal in first:
                yield signal, doubled((first[signal], source.name))
            first.setdefault(signal, source.name)
            if signal.startswith("wheel_counts.") and setup.counts_per_turn is None:
                yield signal, NOT_COUNTED
            if absent := no_such_part(signal, robot):
                yield signal, absent


def estimation_of(setup: Setup, folder: StateFolder | None) -> Estimation:
    """The estimators of a setup, without the saved state.

    folder: state folder with what was learnt on earlier days; None uses the files alone.

    Raises:
        InputError: a file that cannot be read.
    """
    table, days = folder.consumption() if folder else (None, 0.0)
    if folder is None and setup.consumption and Path(setup.consumption).exists():
        table = load_consumption(setup.consumption)
    label = battery = None
    if setup.battery:
        label = _with_voltage_sensor(load_battery(setup.battery), setup)
        battery = _with_voltage_sensor(folder.battery(setup.battery), setup) if folder else label
    return Estimation(
        battery,
        load_robot(setup.robot) if setup.robot else None,
        table,
        setup.delay_s,
        setup.counts_per_turn,
        days,
        time.time(),
        setup.cutoff_V,
        label,
        # the same log gives the same estimates to the last digit
        repeatable_lowering() if any(isinstance(source, ReplaySource) for source in setup.source) else None,
    )


def _with_voltage_sensor(battery: Battery, setup: Setup) -> Battery:
    """The battery as the voltage sensor of this robot measures it, seldom the one of the battery's test."""
    gain_std = setup.voltage_gain_std
    if gain_std is None:
        gain_std = battery.noise.voltage_gain_std or VOLTAGE_GAIN_STD
    return replace(battery, noise=replace(battery.noise, voltage_gain_std=gain_std))
