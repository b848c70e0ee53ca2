"""A quantity is a row of one table: from it alone it is read, wired, replayed, stored, sent and shown."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import ohmward
from ohmward.battery.battery import Battery
from ohmward.logs.units import unit_of
from ohmward.onboard.ros import types
from ohmward.quantities import GROUPS, QUANTITIES, limits_of
from ohmward.traction.robot.packaged import RLMA

SOURCE = Path(ohmward.__file__).parent

#: Adds rows before anything has read the table, as an edit of it would.
ROWS = """
import math
from ohmward.quantities import QUANTITIES, ValueLimits, Quantity, words_of
for row in (
    Quantity("battery_humidity", "relative humidity beside the battery", "battery", "1", ValueLimits(0.0, 1.0),
             words_of("humidity", "rh"), "1 or %", estimated_from=False, ros_type="sensor_msgs/msg/BatteryState",
             ros_field="humidity"),
    Quantity("ground_temperature_degC", "temperature of the ground", "body", "degC", ValueLimits(-60.0, 90.0),
             words_of("ground temperature"), "degC or K", estimated_from=False),
    Quantity("motor_temperature_degC", "temperature of each motor", "motor", "degC", ValueLimits(-60.0, 200.0),
             estimated_from=False),
):
    QUANTITIES[row.name] = row
"""

OF_A_BATTERY = """
import numpy as np
from ohmward import generic_battery, read_log
from ohmward.figures.battery import further_figures
from ohmward.logs.write import write_log
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.message import Wiring
from ohmward.onboard.page.view import view
from ohmward.onboard.sources import replay, ros2
from ohmward.onboard.robot_state import number_at, require_path
from ohmward.onboard.store.rows import RowMaker

with open("bay.csv", "w") as file:
    file.write("time_s,current_A,voltage_V,Humidity [%]\\n")
    for k in range(60):
        file.write(f"{k},-1.0,{12.9 - 0.001 * k},{4500 if k == 30 else 45}\\n")
log = read_log("bay.csv", current_sign="charge")
assert np.allclose(np.delete(log.extra["humidity"], 30), 0.45) and np.isnan(log.extra["humidity"][30]), log.extra
assert any("humidity" in str(note) for note in log.notes)
assert [figure.y_label for figure in further_figures(log)] == ["Humidity [1]"]
write_log(log, "again.csv")
assert "humidity" in read_log("again.csv", current_sign="charge").extra

assert Wiring({"battery_humidity": "rh"}).values({"rh": 0.4}) == {"battery_humidity": 0.4}
numbers = dict.fromkeys(("current", "voltage", "temperature", "percentage", "humidity"), 0.3)
assert ros2._of_table("sensor_msgs/msg/BatteryState", numbers)["battery_humidity"] == 0.3

estimation, rows, states = Estimation(generic_battery("lfp", 10.0, 4)), RowMaker(), []
for time_s, values in replay._of_battery(log):
    states += estimation.put(time_s, values)
measured = [state for state in states if "battery_humidity" in state.sample]
assert len(measured) > 50
require_path("sample.battery_humidity")
assert math.isclose(number_at(measured[0], "sample.battery_humidity"), 0.45)
assert math.isclose(next(rows.rows(measured[0]._replace(unix_s=1e9))).values["battery_humidity"], 0.45)
(beside,) = view(measured[0])["charge"]["beside"]
assert (beside["label"], beside["unit"]) == ("Humidity", "") and math.isclose(beside["value"], 0.45)
"""

OF_A_DRIVE = """
from ohmward import read_drive
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.sources import replay
from ohmward.onboard.store.rows import RowMaker
from ohmward.traction.robot.packaged import RLMA

places = [place.name for place in RLMA.places]
with open("drive.csv", "w") as file:
    speeds = [f"{name}_wheel_speed_rad_s" for name in places]
    file.write(",".join(["time_s", *speeds, "ground_temperature [K]"]) + "\\n")
    for k in range(20):
        file.write(",".join(map(str, [0.1 * k, *[1.0] * len(places), 293.15])) + "\\n")
drive = read_drive("drive.csv", RLMA)
assert math.isclose(drive.extra["ground_temperature_degC"][0], 20.0)

estimation, states = Estimation(robot=RLMA), []
for time_s, values in replay._of_drive(drive):
    states += estimation.put(time_s, {**values, "motor_temperature_degC.0": 40.0})
sample = states[-1].sample
assert math.isclose(sample["ground_temperature_degC"], 20.0)
assert sample[f"motor_temperature_degC.{places[0]}"] == 40.0
(row,) = RowMaker().rows(states[-1]._replace(unix_s=1e9))
assert {"ground_temperature_degC", f"motor_temperature_degC.{places[0]}"} <= row.values.keys()
"""


@pytest.mark.parametrize("use", [OF_A_BATTERY, OF_A_DRIVE], ids=["battery", "drive"])
def test_a_row_of_the_table_is_read_wired_replayed_stored_sent_and_shown(use, tmp_path):
    found = subprocess.run([sys.executable, "-c", ROWS + use], capture_output=True, text=True, cwd=tmp_path)
    assert found.returncode == 0, found.stderr


NAMES = {name for quantity in QUANTITIES.values() for name in (quantity.name, quantity.field)}


def listed(node: ast.AST) -> set[str]:
    """Quantities that a literal lists, as texts in it."""
    parts: list[ast.expr | None] = []
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        parts = [*node.elts]
    elif isinstance(node, ast.Dict):
        parts = [*node.keys, *node.values]
    return NAMES & {part.value for part in parts if isinstance(part, ast.Constant) and isinstance(part.value, str)}


def test_no_other_file_lists_the_quantities():
    """Four of them are the arguments of an estimator or the evidence of a rule; five are a second table."""
    nodes = {path: ast.walk(ast.parse(path.read_text(encoding="utf-8"))) for path in sorted(SOURCE.rglob("*.py"))}
    assert {path.name for path, walk in nodes.items() if any(len(listed(node)) > 4 for node in walk)} == set()


def test_each_row_has_a_unit_of_si_and_a_message_that_there_is():
    for quantity in QUANTITIES.values():
        unit = unit_of(quantity.unit)
        assert quantity.owner == "estimate" or (unit and (unit.scale, unit.offset) == (1.0, 0.0)), quantity
        assert quantity.group in (*GROUPS, "")
        assert bool(quantity.ros_type) == bool(quantity.ros_field)
        assert quantity.ros_type in ("", types.BATTERY_STATE, types.IMU, types.ODOMETRY)


def test_the_limits_of_a_robot_lie_within_those_of_every_sensor():
    battery = ohmward.generic_battery("lfp", 10.0, 4)
    assert isinstance(battery, Battery)
    for name in QUANTITIES:
        here, everywhere = limits_of(name, battery, RLMA), limits_of(name)
        assert everywhere.lowest <= here.lowest < here.highest <= everywhere.highest
    assert limits_of("battery_current_A", battery) == (-200.0, 200.0)
    assert limits_of("cell_voltage_V", battery).highest == pytest.approx(1.1 * battery.voltage_max_V / 4)
    assert limits_of("wheel_speed_rad_s", None, RLMA).highest == 10.0 / RLMA.wheel.radius_m
