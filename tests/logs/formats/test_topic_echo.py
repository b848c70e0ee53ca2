"""Messages of ROS as `ros2 topic echo` writes them, and frames of a CAN bus, which are no signals."""

import numpy as np
import pytest

from ohmward.logs import read_drive, read_log

STAMP = "header:\n  stamp:\n    sec: {}\n    nanosec: {}\n  frame_id: ''\n"


def echoed(write_text, fields):
    """A file of 40 messages at 10 Hz; `fields(k)` are the lines of the k-th below its header."""
    stamps = [STAMP.format(1_770_000_000 + k // 10, k % 10 * 100_000_000) for k in range(40)]
    return write_text("".join(f"{stamp}{fields(k)}---\n" for k, stamp in enumerate(stamps)), "echo.yaml")


@pytest.mark.parametrize("cells", ["cell_voltage:\n- 4.0\n- 4.1\n", "cell_voltage: [4.0, 4.1]\n", ""])
def test_a_battery_state_is_read(write_text, cells):
    path = echoed(write_text, lambda k: f"voltage: {8.1 + 0.01 * k}\ncurrent: -{k}.5\npresent: true\n{cells}")
    log = read_log(path, current_sign="charge")
    np.testing.assert_allclose(log.time_s, 0.1 * np.arange(40), atol=1e-6)
    np.testing.assert_allclose(log.current_A, -0.5 - np.arange(40))
    np.testing.assert_allclose(log.voltage_V, 8.1 + 0.01 * np.arange(40))
    assert ("cell_voltage[1]" in log.extra) == bool(cells)


@pytest.mark.parametrize("dash", ["- ", "  - "])
def test_joint_states_are_read(write_text, dash):
    path = echoed(write_text, lambda k: f"name:\n{dash}left\n{dash}right\nvelocity:\n{dash}{k}.0\n{dash}{2 * k}.0\n")
    log = read_drive(path, ("left", "right"), 2)
    np.testing.assert_allclose(log.wheel_speed_rad_s, np.column_stack([np.arange(40), 2 * np.arange(40)]))
