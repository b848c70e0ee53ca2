"""Messages against Cyclone DDS, the middleware of many a ROS 2: its own types read and write the same bytes."""

# mypy: ignore-errors

from dataclasses import dataclass

import numpy as np
import pytest

from ohmward.onboard.ros import messages, types
from ohmward.onboard.ros.cdr import serialize

from .test_messages import driven

idl = pytest.importorskip("cyclonedds.idl", reason="cyclonedds is not installed: pip install cyclonedds")
from cyclonedds.idl import IdlStruct  # noqa: E402
from cyclonedds.idl import types as t  # noqa: E402


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: t.int32
    nanosec: t.uint32


@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str


@dataclass
class BatteryState(IdlStruct, typename="sensor_msgs.msg.dds_.BatteryState_"):
    header: Header
    voltage: t.float32
    temperature: t.float32
    current: t.float32
    charge: t.float32
    capacity: t.float32
    design_capacity: t.float32
    percentage: t.float32
    power_supply_status: t.uint8
    power_supply_health: t.uint8
    power_supply_technology: t.uint8
    present: bool
    cell_voltage: t.sequence[t.float32]
    cell_temperature: t.sequence[t.float32]
    location: str
    serial_number: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):
    x: t.float64
    y: t.float64
    z: t.float64


@dataclass
class TwistOnly(IdlStruct, typename="geometry_msgs.msg.dds_.Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs.msg.dds_.TwistWithCovariance_"):
    twist: TwistOnly
    covariance: t.array[t.float64, 36]


@dataclass
class TwistStamped(IdlStruct, typename="geometry_msgs.msg.dds_.TwistWithCovarianceStamped_"):
    header: Header
    twist: TwistWithCovariance


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs.msg.dds_.KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticStatus_"):
    level: t.byte
    name: str
    message: str
    hardware_id: str
    values: t.sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticArray_"):
    header: Header
    status: t.sequence[DiagnosticStatus]


def sent() -> dict[str, bytes]:
    state = driven()
    measured = {"battery_voltage_V": 13.1, "battery_current_A": -3.0, "cell_voltage_V.0": 3.25, "cell_voltage_V.1": 3.5}
    found = {
        types.BATTERY_STATE: messages.battery_state(state, measured, None, "base_link"),
        types.TWIST: messages.twist(state, "base_link"),
        types.DIAGNOSTICS: messages.diagnostics(state, "rover", state.unix_s),
    }
    return {type_: serialize(type_, message) for type_, message in found.items()}


KINDS = {types.BATTERY_STATE: BatteryState, types.TWIST: TwistStamped, types.DIAGNOSTICS: DiagnosticArray}


@pytest.mark.parametrize("type_", KINDS)
def test_cyclone_dds_reads_and_writes_the_same_bytes(type_):
    payload = sent()[type_]
    message = KINDS[type_].deserialize(payload)
    assert message.serialize(use_version_2=False) == payload


def test_the_fields_are_those_of_the_state():
    state = driven()
    battery = BatteryState.deserialize(sent()[types.BATTERY_STATE])
    assert (battery.header.frame_id, battery.present) == ("base_link", True)
    assert (battery.voltage, battery.current) == (np.float32(13.1), -3.0)
    assert state.battery and battery.percentage == np.float32(state.battery.soc)
    twist = TwistStamped.deserialize(sent()[types.TWIST])
    assert state.slip and twist.twist.twist.linear.x == float(state.slip.speed_m_s)
    names = [status.name for status in DiagnosticArray.deserialize(sent()[types.DIAGNOSTICS]).status]
    assert any("rover" in name or "ohmward" in name for name in names)
