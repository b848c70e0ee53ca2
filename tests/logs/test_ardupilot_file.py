"""Logs of ArduPilot: DataFlash made record by record as its own FMT messages say, telemetry written by pymavlink."""

import struct
from pathlib import Path

import numpy as np
import pytest

from logs.formats.recorders import fmt_messages
from ohmward.errors import InputError
from ohmward.logs import read_drive, read_log

pytest.importorskip("pymavlink")

N = 400
K = np.arange(N)
CURRENT_A = np.where(K % 40 < 20, 0.5, 8.0).astype(np.float32)
VOLTAGE_V = (15.0 - 0.05 * CURRENT_A - 0.001 * K).astype(np.float32)

#: Type, name, format (Q uint64, B uint8, f float, i int32, H uint16) and columns.
FORMATS = (
    (128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 89),
    (130, "BAT", "QBfff", "TimeUS,Inst,Volt,Curr,Temp", 24),
    (131, "WENC", "Qff", "TimeUS,Dist0,Dist1", 19),
    (132, "IMU", "QBff", "TimeUS,I,GyrZ,AccX", 20),
    (133, "PIDR", "Qff", "TimeUS,Tar,I", 19),
)


def dataflash(batteries: int = 1) -> bytes:
    content = fmt_messages(FORMATS)
    for k in range(N):
        us = 12_000_000 + 100_000 * k
        for inst in range(batteries):
            content += b"\xa3\x95" + struct.pack(
                "<BQBfff", 130, us, inst, VOLTAGE_V[k], (inst + 1) * CURRENT_A[k], 21.5
            )
        content += b"\xa3\x95" + struct.pack("<BQff", 131, us + 10, 0.02 * k, 0.01 * k)
        for inst in range(2):
            content += b"\xa3\x95" + struct.pack("<BQBff", 132, us + 20, inst, -0.3, 0.0)
        content += b"\xa3\x95" + struct.pack("<BQff", 133, us + 30, 1.0, 0.1 * k)
    return content


def telemetry(systems: int = 1) -> bytes:
    from pymavlink.dialects.v20 import ardupilotmega

    class Sink:
        def __init__(self) -> None:
            self.packets: list[bytes] = []

        def write(self, packet: bytes) -> None:
            self.packets.append(bytes(packet))

    sink, content = Sink(), b""
    senders = [ardupilotmega.MAVLink(sink, srcSystem=1 + number) for number in range(systems)]
    for k in range(N):
        cells = [round(1000 * float(VOLTAGE_V[k]) / 4)] * 4 + [65535] * 6
        for number, mav in enumerate(senders, start=1):
            mav.battery_status_send(0, 0, 0, 2150, cells, round(100 * number * float(CURRENT_A[k])), -1, -1, 80)
            mav.wheel_distance_send(1000 * k, 2, [0.02 * k, 0.01 * k, *[0.0] * 14])
    for number, packet in enumerate(sink.packets):
        content += struct.pack(">Q", 1_770_000_000_000_000 + 50_000 * number) + packet
    return content


def write(folder: Path, name: str, content: bytes) -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


def test_a_battery_of_dataflash(tmp_path):
    log = read_log(write(tmp_path, "flight.bin", dataflash()))
    np.testing.assert_array_equal(log.current_A, -CURRENT_A)
    np.testing.assert_array_equal(log.voltage_V, VOLTAGE_V)
    np.testing.assert_allclose(log.dt_s, 0.1, atol=1e-9)
    np.testing.assert_allclose(log.measured()["temperature_degC"], 21.5)


def test_the_battery_of_a_second_vehicle_is_named(tmp_path):
    path = write(tmp_path, "two.tlog", telemetry(systems=2))
    with pytest.raises(InputError, match=r"both BATTERY_STATUS\[0\] and BATTERY_STATUS\[2000\] are of type"):
        read_log(path)
    log = read_log(path, where={"topic": "BATTERY_STATUS[2000]"})
    np.testing.assert_allclose(log.current_A, -2 * CURRENT_A, atol=1e-6)


def test_a_second_battery_is_named(tmp_path):
    path = write(tmp_path, "two.bin", dataflash(batteries=2))
    with pytest.raises(InputError, match=r"both BAT\[0\] and BAT\[1\] are of type BAT; choose with --topic"):
        read_log(path)
    np.testing.assert_array_equal(read_log(path, where={"topic": "BAT[1]"}).current_A, -2 * CURRENT_A)


def test_wheels_and_the_gyro_of_dataflash_whose_z_points_down(tmp_path):
    drive = read_drive(write(tmp_path, "drive.bin", dataflash()), ("left", "right"), 2, radius_m=0.1)
    speed = drive.wheel_speed_rad_s[np.isfinite(drive.wheel_speed_rad_s).all(axis=1)]
    np.testing.assert_allclose(speed, [[2.0, 1.0]] * (N - 1), rtol=1e-3)
    assert np.nanmedian(drive.columns()["yaw_rate_rad_s"]) == pytest.approx(0.3)


def test_any_other_message_is_read_where_it_is_named(tmp_path):
    path = write(tmp_path, "flight.bin", dataflash())
    log = read_log(path, where={"topic": "BAT,PIDR"}, columns={"temperature": "PIDR/I"})
    np.testing.assert_allclose(np.sort(log.measured()["temperature_degC"])[1:], 0.1 * K[1:], atol=1e-4)


def test_a_battery_of_telemetry(tmp_path):
    log = read_log(write(tmp_path, "flight.tlog", telemetry()))
    np.testing.assert_allclose(log.current_A, -CURRENT_A, atol=0.006)
    np.testing.assert_allclose(log.voltage_V, VOLTAGE_V, atol=0.003)
    np.testing.assert_allclose(log.measured()["temperature_degC"], 21.5)
    assert log.start_unix_s == 1_770_000_000.0


def test_wheels_of_telemetry(tmp_path):
    drive = read_drive(write(tmp_path, "flight.tlog", telemetry()), ("left", "right"), 2, radius_m=0.1)
    assert np.nanmedian(drive.wheel_speed_rad_s[:, 0]) == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize("content", [dataflash, telemetry])
def test_a_log_that_was_cut_off_gives_what_is_before_the_cut(content, tmp_path):
    whole = content()
    log = read_log(write(tmp_path, "cut", whole[: len(whole) // 2 + 5]), current_sign="discharge")
    assert 0.45 * N < len(log) < 0.55 * N


@pytest.mark.parametrize(
    "head", [b"\xa3\x95\x80" + bytes(40), (1_770_000_000_000_000).to_bytes(8, "big") + b"\xfd" + bytes(40)]
)
def test_a_log_without_a_message_is_refused(head, tmp_path):
    with pytest.raises(InputError, match=r"no readable log of ArduPilot|holds no message"):
        read_log(write(tmp_path, "bad", head))


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="open files are seen under /proc alone")
def test_a_file_that_is_refused_is_closed(tmp_path):
    path = tmp_path / "log.log"
    path.write_bytes(b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nBAT, 1\x80\n")
    with pytest.raises(InputError, match="no readable log of ArduPilot") as refused:
        read_log(path)
    assert refused.value.__cause__ is not None  # whose frames would keep it open
    assert str(path) not in {str(link.readlink()) for link in Path("/proc/self/fd").iterdir() if link.exists()}
