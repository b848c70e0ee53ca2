from dataclasses import replace

import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import save_battery
from ohmward.errors import InputError
from ohmward.traction import RLMA, ROBOTINO, save_robot
from ohmward_lab.simulate.closed_loop.control import Command, Control
from ohmward_lab.simulate.closed_loop.observing import Observing
from ohmward_lab.simulate.closed_loop.scenario import (
    ROBOTS,
    Scenario,
    find_scenario,
    load_scenario,
    packaged,
    packaged_text,
    parse_scenario,
    save_scenario,
)
from ohmward_lab.simulate.closed_loop.sensing import ExternalSpeed, Sensing
from ohmward_lab.simulate.closed_loop.supply import Pack
from ohmward_lab.simulate.ground import Grade, Patch

FIVE_LINES = """\
format = "ohmward-scenario/1"
duration_s = 8.0
[[commands]]
speed_m_s = 0.5
"""
FULL = Scenario(
    duration_s=7.5,
    commands=(Command(0.0, speed_m_s=0.4, yaw_rate_rad_s=0.1), Command(3.25, speed_m_s=-0.2)),
    robot="robotino",
    battery=Pack("lead-acid", 0.55, 10.0),
    ground=(Patch(terrain="gravel", rolling=0.03), Patch(friction=0.2, from_m=1.0, wheels=("wheel_1",))),
    grade=Grade((0.0, 1.5), (0.0, 0.05)),
    sensors=Sensing(encoders=("wheel_1", "wheel_2"), pitch=True, speed=ExternalSpeed(0.1, delay_s=0.05)),
    controller=Control("ramp", acceleration_m_s2=0.25),
    seed=7,
    name="everything",
)


def test_five_lines_are_enough():
    scenario = parse_scenario(FIVE_LINES)
    assert scenario == Scenario(8.0, (Command(speed_m_s=0.5),))
    assert scenario.model.name == "RLMA"


def test_a_scenario_comes_back_from_its_file(tmp_path):
    save_scenario(FULL, tmp_path / "full.toml")
    assert load_scenario(tmp_path / "full.toml") == FULL


def test_a_scenario_without_a_name_takes_that_of_its_file(tmp_path):
    (tmp_path / "my.toml").write_text(FIVE_LINES)
    assert load_scenario(tmp_path / "my.toml").name == "my"
    assert find_scenario(str(tmp_path / "my.toml")).name == "my"


def test_a_robot_may_be_a_file(tmp_path):
    save_robot(replace(ROBOTINO, name="mine"), tmp_path / "robot.toml")
    text = FIVE_LINES.replace("duration_s", f"robot = '{tmp_path / 'robot.toml'}'\nduration_s")
    assert parse_scenario(text).model.name == "mine"


def test_paths_count_from_the_folder_of_the_scenario(tmp_path):
    save_robot(replace(ROBOTINO, name="mine"), tmp_path / "robot.toml")
    save_battery(generic_battery("lipo", 8.0, 10), tmp_path / "battery.toml")
    (tmp_path / "my.toml").write_text(
        FIVE_LINES.replace("duration_s", "robot = 'robot.toml'\nbattery = { file = 'battery.toml' }\nduration_s")
    )
    scenario = load_scenario(tmp_path / "my.toml")
    assert scenario.model.name == "mine"
    assert scenario.battery.battery.circuit.capacity_Ah == 8.0
    save_scenario(scenario, tmp_path / "again.toml")
    assert load_scenario(tmp_path / "again.toml") == scenario


@pytest.mark.parametrize(
    "file, message",
    [
        ("nowhere.toml", "my.toml: .*nowhere.toml: cannot be read .*; check the path, or make one"),
        ("robot.toml", "my.toml: .*robot.toml: this is a robot file; give a battery file"),
        ("battery.csv", r"my.toml: battery.file must be a battery file \(.toml\), got 'battery.csv'$"),
    ],
)
def test_a_battery_file_that_is_none_is_refused_in_one_line(file, message, tmp_path):
    save_robot(RLMA, tmp_path / "robot.toml")
    text = FIVE_LINES.replace("duration_s", f"battery = {{ file = '{file}' }}\nduration_s")
    (tmp_path / "my.toml").write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        load_scenario(tmp_path / "my.toml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", packaged())
def test_packaged_scenarios_are_scenarios_and_say_what_they_are(name):
    assert find_scenario(name).duration_s > 0
    assert len(packaged()[name]) > 20


def test_the_example_shows_every_key():
    text = packaged_text("example")
    missing = [
        f"{key}"
        for part in (Scenario, Pack, Patch, Grade, Sensing, ExternalSpeed, Control, Command)
        for key in part.__dataclass_fields__
        if key not in text
    ]
    assert missing == []


@pytest.mark.parametrize(
    "change, message",
    [
        ({"duration_s": 0.0}, "duration_s must be between 0.01 and 86400"),
        ({"robot": "k9"}, rf"robot must be one of {', '.join(ROBOTS)}, or a robot file \(.toml\); got 'k9'"),
        ({"robot": "nowhere.toml"}, "nowhere.toml: cannot be read"),
        ({"plant": "real"}, "plant must be one of own, mujoco, got 'real'"),
        ({"commands": ()}, "commands must begin with from_s = 0"),
        ({"commands": (Command(1.0, speed_m_s=0.1),)}, r"commands must begin with from_s = 0 .* got from_s = \[1.0\]"),
        (
            {"commands": (Command(speed_m_s=0.1), Command(9.0, speed_m_s=0.1))},
            "commands.from_s must be below duration_s",
        ),
        ({"commands": (Command(speed_m_s=5.0),)}, "commands.speed_m_s must keep the wheels below 0.5.* ask for less"),
        ({"sensors": Sensing(interval_s=1e-4)}, "sensors.interval_s must be at least controller.interval_s"),
        ({"sensors": Sensing(encoders=("front_left",))}, "sensors.encoders must be"),
        ({"ground": (Patch(friction=0.1), Patch(friction=0.2))}, "2 patches have no edge"),
        ({"seed": -1}, "seed must be between"),
        ({"drag_N_s2_per_m2": -1.0}, "drag_N_s2_per_m2 must be"),
        ({"start_speed_m_s": float("nan")}, "start_speed_m_s must be"),
        ({"start_speed_m_s": 1.0, "observer": Observing("momentum")}, "knows its speed from a standstill"),
    ],
)
def test_scenarios_that_cannot_be_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(FULL, **change)


@pytest.mark.parametrize(
    "line, message",
    [
        ("speed = 1.0", "speed is not a key of a scenario file"),
        ("duration = 1.0", r"duration is not a key .* did you mean duration_s\?"),
        ("seed = 'one'", "seed: expected `int`"),
        ("ground = [{ friction = 0.1, colour = 'grey' }]", r"ground\[0\].colour is not a key"),
        ("battery = { start_soc = 80 }", "start_soc must be > 0 and at most 1"),
    ],
)
def test_files_that_say_something_else_are_refused(line, message):
    with pytest.raises(InputError, match=message):
        parse_scenario(FIVE_LINES.replace("[[commands]]", f"{line}\n[[commands]]"))


def test_a_name_that_is_nothing_lists_what_there_is():
    with pytest.raises(InputError, match="nowhere: no such file, and no scenario of that name; there are: example, "):
        find_scenario("nowhere")
