"""A small board: `pip install --no-deps ohmward`, NumPy and msgspec, and nothing else. There `update()` runs."""

import importlib.util
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

import ohmward
from ohmward import generic_battery, save_battery, save_robot
from ohmward.traction import RLMA

#: All that there is on the board.
INSTALLED = ("numpy", "msgspec")

PROGRAM = """
import sys
import ohmward as ow

soc = ow.SocEstimator(ow.load_battery("battery.toml"), initial_soc=0.8)
for k in range(5):
    now = soc.update(float(k), current_A=-4.2, voltage_V=13.1)
soc = ow.SocEstimator.restore(ow.load_battery("battery.toml"), soc.snapshot())
now = soc.update(5.0, current_A=None, voltage_V=13.1)
assert str(now.flags) == "NO_CURRENT" and 0.6 < now.soc < 0.9, now

slip = ow.SlipEstimator(ow.load_robot("robot.toml"), filter="ekf")
for k in range(5):
    speed = slip.update(0.01 * k, wheel_speed_rad_s=[2.0, 2.0], current_A=[0.2, 0.2])
assert 0.1 < speed.speed_m_s < 0.4, speed

left = ow.RangeEstimator(ow.load_battery("battery.toml"), ow.load_robot("robot.toml"))
for k in range(5):
    reach = left.update(float(k), now, speed_m_s=0.5, current_A=-4.2, voltage_V=13.1, home=100.0)
assert reach.distance_m.p10 < reach.distance_m.p90 and reach.home_probability > 0.9, reach

loaded = {name.partition(".")[0] for name in sys.modules}
assert not loaded & {"scipy", "llvmlite", "pyarrow", "rich", "pandas", "tomli_w"}, loaded
try:
    ow.save_battery(ow.load_battery("battery.toml"), "copy.toml")
except ow.OhmwardError as error:
    assert "pip install tomli-w" in str(error)
else:
    raise AssertionError("saving needs tomli-w")
"""


@pytest.fixture(scope="module")
def board(tmp_path_factory) -> Path:
    """Python of an environment that holds ohmward's files and the installed packages of `INSTALLED` alone."""
    home = tmp_path_factory.mktemp("board")
    venv.create(home, with_pip=False, symlinks=True)
    python = home / "bin" / "python"
    site = next((home / "lib").glob("python*/site-packages"))
    shutil.copytree(Path(ohmward.__file__).parent, site / "ohmward", ignore=shutil.ignore_patterns("__pycache__"))
    for name in INSTALLED:
        spec = importlib.util.find_spec(name)
        assert spec and spec.origin
        package = Path(spec.origin).parent
        for part in (package, package.with_name(f"{name}.libs")):
            if part.exists():
                (site / part.name).symlink_to(part)
    return python


@pytest.mark.skipif(sys.platform == "win32", reason="links packages into the environment")
def test_update_runs_with_numpy_and_msgspec_alone(board, tmp_path):
    save_battery(generic_battery("lfp", 12.0, n_series=4), tmp_path / "battery.toml")
    save_robot(RLMA, tmp_path / "robot.toml")
    done = subprocess.run([board, "-I", "-c", PROGRAM], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
