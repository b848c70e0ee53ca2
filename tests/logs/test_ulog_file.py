"""ULog files of PX4, made record by record as docs.px4.io/main/en/dev_log/ulog_file_format describes them."""

import struct
import warnings
from pathlib import Path

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import read_drive, read_log

pytest.importorskip("pyulog")
N = 400


def record(kind: bytes, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), kind[0]) + content


def write_ulog(path: Path, instances: int = 1) -> dict[str, np.ndarray]:
    """A file with a battery (positive current discharges) and wheels; what it holds."""
    rng = np.random.default_rng(4)
    current_A = np.where((np.arange(N) // 40) % 3 == 0, 8.0, 0.5) + rng.normal(0, 0.01, N)
    known = {"current": current_A, "voltage": 15.0 - 0.05 * current_A + rng.normal(0, 0.002, N)}
    known = {name: values.astype(np.float32) for name, values in known.items()}
    content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + record(b"B", bytes(40))
    content += record(b"F", b"battery_status:uint64_t timestamp;float voltage_v;float current_a;float remaining;")
    content += record(b"F", b"wheel_encoders:uint64_t timestamp;float[2] wheel_speed;")
    for instance in range(instances):
        content += record(b"A", struct.pack("<BH", instance, instance) + b"battery_status")
    content += record(b"A", struct.pack("<BH", 0, 9) + b"wheel_encoders")
    for k in range(N):
        for instance in range(instances):
            values = (1_000_000 + 100_000 * k, known["voltage"][k], known["current"][k] * (instance + 1), 0.5)
            content += record(b"D", struct.pack("<HQfff", instance, *values))
        content += record(b"D", struct.pack("<HQff", 9, 1_000_000 + 100_000 * k, 0.01 * k, 0.02 * k))
    path.write_bytes(content)
    return known


def test_a_battery_and_the_sign_of_its_current(tmp_path):
    known = write_ulog(tmp_path / "flight.ulg")
    log = read_log(tmp_path / "flight.ulg")
    assert log.name == "flight"
    np.testing.assert_array_equal(log.current_A, -known["current"])
    np.testing.assert_array_equal(log.voltage_V, known["voltage"])
    np.testing.assert_allclose(log.dt_s, 0.1, atol=1e-9)


def test_a_current_that_is_not_measured_is_none(tmp_path):
    """PX4 writes -1 where it has no sensor."""
    known = write_ulog(tmp_path / "flight.ulg")
    content = (tmp_path / "flight.ulg").read_bytes()
    for value in known["current"]:
        content = content.replace(struct.pack("<ff", value, 0.5), struct.pack("<ff", -1.0, 0.5))
    (tmp_path / "flight.ulg").write_bytes(content)
    with pytest.raises(InputError, match=r"column 'current \[A\]' has no value"):
        read_log(tmp_path / "flight.ulg")


def test_wheels(tmp_path):
    write_ulog(tmp_path / "drive.ulg")
    log = read_drive(tmp_path / "drive.ulg", ("left", "right"), 2)
    np.testing.assert_allclose(log.wheel_speed_rad_s[:, 1], 0.02 * np.arange(N), rtol=1e-6)


def test_a_second_battery_is_named(tmp_path):
    known = write_ulog(tmp_path / "two.ulg", instances=2)
    with pytest.raises(InputError, match=r"both battery_status and battery_status\[1\] are of type battery_status"):
        read_log(tmp_path / "two.ulg")
    log = read_log(tmp_path / "two.ulg", where={"topic": "battery_status[1]"})
    np.testing.assert_array_equal(log.current_A, -2 * known["current"])


def test_a_file_that_was_cut_gives_what_is_before_the_cut(tmp_path):
    path = tmp_path / "cut.ulg"
    write_ulog(path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2 + 5])
    assert 0.4 * N < len(read_log(path, current_sign="discharge")) < 0.6 * N


def test_what_cannot_be_read_is_not_printed(tmp_path, capfd):
    """Standard output carries results, of which one may be JSON."""
    path = tmp_path / "log.ulg"
    known = write_ulog(path)
    with path.open("ab") as stream:
        stream.write(record(b"D", struct.pack("<HQ", 77, 0)))  # of no subscription
    np.testing.assert_array_equal(read_log(path).voltage_V, known["voltage"])
    assert capfd.readouterr() == ("", "")


def test_a_topic_whose_time_is_damaged_is_left_out(tmp_path):
    path = tmp_path / "log.ulg"
    write_ulog(path)
    path.write_bytes(path.read_bytes().replace(b"uint64_t timestamp;float[2]", b"uint64_t tmestamp_;float[2]"))
    log = read_log(path)
    assert any("damaged: what could not be read" in note.text for note in log.notes)


def test_a_signalling_nan_is_missing(tmp_path):
    path = tmp_path / "log.ulg"
    known = write_ulog(path)
    signalling = np.array([0x7F800001], np.uint32).tobytes()
    path.write_bytes(path.read_bytes().replace(known["voltage"][5].tobytes(), signalling, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        log = read_log(path)
    assert np.isnan(log.voltage_V).sum() == 1


def test_an_unknown_message_that_is_cut_off_ends_the_reading(tmp_path):
    """It claims a hundred bytes, of which the file has five."""
    path = tmp_path / "log.ulg"
    write_ulog(path)
    content = path.read_bytes()
    definitions = content[: content.index(b"A", content.index(b"wheel_speed")) - 2]
    path.write_bytes(definitions + struct.pack("<HB", 100, 0) + bytes([1] * 5))
    with pytest.raises(InputError, match="no topic of type battery_status"):
        read_log(path)


def test_a_file_that_is_no_ulog_inside_is_refused(tmp_path):
    path = tmp_path / "bad.ulg"
    path.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(5))
    with pytest.raises(InputError, match=r"ULog|no message|no topic"):
        read_log(path)


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="open files are seen under /proc alone")
def test_a_file_that_is_refused_is_closed(tmp_path):
    path = tmp_path / "log.ulg"
    path.write_bytes(b"ULog\x01\x12\x35")
    with pytest.raises(InputError, match="no readable ULog file") as refused:
        read_log(path)
    assert refused.value.__cause__ is not None  # whose frames would keep it open
    assert str(path) not in {str(link.readlink()) for link in Path("/proc/self/fd").iterdir() if link.exists()}
