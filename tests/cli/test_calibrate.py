"""`ohmward calibrate` and `ohmward slip --floors` from the outside: figures, files, refusals."""

import numpy as np
import pytest

from cli import test_slip
from ohmward.cli.main import main
from ohmward.logs import write_table
from ohmward.traction import load_robot, save_robot
from ohmward.traction.terrain.floor import load_floors
from traction.terrain.drives import OMNI, SMOOTH, SOFT, omni_drive

POSE = ("--pose", "x,y,angle", "--pose-scale", "0.001,-0.001", "--pose-turn", "90", "--each", "run")
RUNS = 6
KEYS = {"command", "robot", "drives", "duration_s", "parameters", "floor", "notes", "output", "floors", "report"}


def columns(run: int, floor, seed: int) -> dict[str, np.ndarray]:
    """One drive as robot and camera record it: pixels of 1 mm, rows downwards, a mark turned by 90 degrees."""
    drive = omni_drive([floor] * 3, 360 / RUNS * run + 10, seconds=6.0, rng=np.random.default_rng(seed))
    log = drive.log
    dt_s = np.diff(log.time_s, prepend=log.time_s[0])
    v_x, v_y, yaw_rate = drive.motion.mean(axis=0)
    heading = 0.2 + yaw_rate * log.time_s
    east = np.cumsum(dt_s * (np.cos(heading) * v_x - np.sin(heading) * v_y))
    north = np.cumsum(dt_s * (np.sin(heading) * v_x + np.cos(heading) * v_y))
    found = {"time_s": log.time_s, "run": np.full(len(log), float(run))}
    for k, place in enumerate(OMNI.places):
        found[f"{place.name}_wheel_speed_rad_s"] = log.wheel_speed_rad_s[:, k]
        found[f"{place.name}_motor_current_A"] = log.motor_current_A[:, k]
    return found | {"x": 1e3 * east, "y": -1e3 * north, "angle": np.degrees(heading) - 90.0}


def write(path, floor):
    parts = [columns(run, floor, run) for run in range(RUNS)]
    write_table({name: np.concatenate([p[name] for p in parts]) for name in parts[0]}, path)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("floors")
    write(folder / "smooth.csv", SMOOTH)
    write(folder / "soft.csv", SOFT)
    save_robot(OMNI, folder / "start.toml")
    return folder


@pytest.fixture
def folder(files, tmp_path, monkeypatch):
    for file in files.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_from_drives_to_a_robot_its_floors_and_its_slip(folder, as_json, capsys):
    robot = as_json("calibrate", "smooth.csv", "--robot", "start.toml", *POSE, "-o", "robot.toml")
    assert set(robot) == KEYS
    known = {p["name"]: p for p in robot["parameters"]}
    assert known["wheel.radius_m"]["value"] == pytest.approx(0.036, rel=0.005)
    assert known["motor.friction_Nm"]["identified"]
    assert load_robot("robot.toml").motor.friction_Nm == pytest.approx(0.15, abs=0.02)
    for name in ("smooth", "soft"):
        floor = as_json(
            "calibrate", f"{name}.csv", "--robot", "robot.toml", *POSE, "--floor", name, "--floors", "floors.toml"
        )
        assert floor["parameters"] == []
        assert floor["drives"] == RUNS
    assert [f.name for f in load_floors("floors.toml").floor] == ["smooth", "soft"]
    on_soft = ("slip", "soft.csv:run=1", "--robot", "robot.toml", "--floors", "floors.toml")
    found = as_json(*on_soft, "-o", "slip.csv", "--report", "slip.html")
    assert set(found) == test_slip.KEYS | test_slip.SCORES
    assert 0.1 < found["travel_slip_mean"] < 0.45
    assert found["floor_share"]["soft"] > 0.8
    assert found["floor_crossings"] == []
    assert "wheel_1_on_soft" in (folder / "slip.csv").read_text(encoding="utf-8").partition("\n")[0]
    assert "Floor under wheel 1" in (folder / "slip.html").read_text(encoding="utf-8")
    assert main(on_soft) == 0
    assert "floors under the wheels" in capsys.readouterr().out
    told = as_json(*on_soft, "--floor", "soft")
    assert told["floor_share"] == {"soft": pytest.approx(1.0)}
    assert told["travel_slip_std"] < found["travel_slip_std"]
    assert "robot" in {episode["wheel"] for episode in told["slip_episodes"]}
    assert main([*on_soft, "--floor", "ice"]) == 2
    assert "no floor 'ice' has been learnt; the file has smooth, soft" in capsys.readouterr().err
    assert main(["slip", "soft.csv:run=1", "--robot", "robot.toml", "--floor", "soft"]) == 2
    assert "--floor NAME chooses from --floors FILE.toml" in capsys.readouterr().err


def test_the_topic_of_a_pose_is_its_columns(folder, as_json):
    """A position with a quaternion, of a mark that is tilted by 0.3 rad about its own x, beside x, y and heading."""
    parts = columns(0, SMOOTH, 0)
    heading, tilt = np.radians(parts.pop("angle") + 90.0) / 2, 0.15
    quaternion = np.cos(heading) * np.sin(tilt), np.sin(heading) * np.sin(tilt), np.sin(heading) * np.cos(tilt)
    topic = {"/mark/pose.position.x": 1e-3 * parts.pop("x"), "/mark/pose.position.y": -1e-3 * parts.pop("y")}
    topic |= {f"/mark/pose.orientation.{axis}": q for axis, q in zip("xyz", quaternion, strict=True)}
    topic["/mark/pose.orientation.w"] = np.cos(heading) * np.cos(tilt)
    write_table(parts | topic, "mocap.csv")
    words = ("--robot", "start.toml", "--what", "radius", "-o", "robot.toml")
    by_topic = as_json("calibrate", "mocap.csv", *words, "--pose", "/mark")
    by_columns = as_json("calibrate", "smooth.csv:run=0", *words, *POSE[:-2])
    (one,), (other,) = by_topic["parameters"], by_columns["parameters"]
    assert one["value"] == pytest.approx(other["value"], rel=1e-6)


def test_what_people_read(folder, capsys):
    assert main(["calibrate", "soft.csv", "--robot", "start.toml", *POSE, "--report", "page.html"]) == 0
    out = capsys.readouterr().out
    assert "wheel.radius_m" in out
    assert "Not identified" in out
    assert "No robot file written" in out
    page = (folder / "page.html").read_text(encoding="utf-8")
    assert "Speed of the body and of the rims" in page


def test_loads_as_weighed_are_written(folder, as_json):
    words = ("calibrate", "smooth.csv", "--robot", "start.toml", *POSE, "--what", "radius", "-o", "robot.toml")
    as_json(*words, "--wheel-load", "30,51,30")
    assert load_robot("robot.toml").wheel_load_N == (30.0, 51.0, 30.0)
    assert load_robot("robot.toml").mass_kg == pytest.approx(111.0 / 9.80665)


@pytest.mark.parametrize(
    "words, message",
    [
        ((*POSE, "--truth", "x"), "give either --truth COLUMN, a measured speed, or --pose X,Y,HEADING"),
        ((), "no speed from outside; name its column (--column speed=NAME, --truth NAME, --pose X,Y,HEADING or TOPIC)"),
        (("--pose", "x,y"), "--pose takes three columns X,Y,HEADING of the log, got 'x,y'"),
        (("--truth", "x"), "moves sideways too"),
        ((*POSE, "--floor", "soft"), "--floor NAME and --floors FILE.toml belong together"),
        ((*POSE, "--what", "mass"), "--what takes radius, track, motor, separated by commas; got 'mass'"),
        ((*POSE[:-1], "lap"), "there is no column 'lap' for --each"),
        ((*POSE, "-o", "smooth.csv"), "the name must end in .toml"),
        ((*POSE, "--wheel-load", "3,5,3"), "(--wheel-load) add up to 11 N, the robot file's mass weighs 110.8 N"),
    ],
)
def test_what_cannot_work_is_refused(folder, refused, words, message):
    assert message in refused("calibrate", "smooth.csv:run=0", "--robot", "start.toml", *words)


def test_floors_of_another_robot_are_told(folder, as_json):
    as_json("calibrate", "soft.csv", "--robot", "start.toml", *POSE, "--floor", "soft", "--floors", "floors.toml")
    text = (folder / "floors.toml").read_text(encoding="utf-8").replace('robot = "Robotino"', 'robot = "Other"')
    (folder / "floors.toml").write_text(text, encoding="utf-8")
    found = as_json("slip", "soft.csv:run=1", "--robot", "start.toml", "--floors", "floors.toml")
    assert "warning: the floors were learnt by 'Other', the robot is 'Robotino'" in found["notes"]


def test_samples_in_which_something_is_missing_are_told(folder, as_json):
    as_json("calibrate", "soft.csv", "--robot", "start.toml", *POSE, "--floor", "soft", "--floors", "floors.toml")
    holed = columns(1, SOFT, 1)
    name = next(name for name in holed if name.endswith("current_A"))
    write_table(holed | {name: np.where(np.arange(200) // 5 == 20, np.nan, holed[name])}, "holed.csv")
    found = as_json("slip", "holed.csv", "--robot", "start.toml", "--floors", "floors.toml")
    assert "warning: 5 samples with no current" in found["notes"]
