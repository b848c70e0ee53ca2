"""The traction half in C: observers and controllers, compiled and run as their user would."""

import subprocess

import pytest

from needs import needs_gcc
from ohmward.embedded import controller_export, library, observer_export, odometry_export, write_library
from ohmward.embedded.c_library import size
from ohmward.embedded.traction import CONTROLLERS
from ohmward.errors import InputError
from ohmward.traction import RLMA, ROBOTINO, hard_terrain

ASPHALT = hard_terrain("dry asphalt")


def passes(export, folder):
    write_library(library(export), folder)
    command = ["make", "-s", "-C", folder, "CFLAGS=-O0 -Werror", "test"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0 and not result.stderr, result.stdout + result.stderr
    assert "64 of 64 vectors right to the last bit" in result.stdout


@needs_gcc
@pytest.mark.parametrize("controller", CONTROLLERS)
def test_controllers(controller, tmp_path):
    passes(controller_export(ROBOTINO, controller), tmp_path)


@needs_gcc
def test_the_observer(tmp_path):
    passes(observer_export(RLMA, ASPHALT, "ekf"), tmp_path)


@pytest.mark.parametrize("robot", [RLMA, ROBOTINO], ids=lambda robot: robot.name)
def test_odometry(robot, tmp_path):
    passes(odometry_export(robot), tmp_path)


@needs_gcc
@pytest.mark.slow
def test_the_adaptive_unscented_observer(tmp_path):
    passes(observer_export(ROBOTINO, ASPHALT, "aukf"), tmp_path)


def test_the_readme_asks_for_a_flag_where_the_controller_has_it():
    text = library(controller_export(RLMA, "slip-controller", "wheel"))["README.md"]
    assert "(unsigned)output.report_flags & WHEEL_STALE" in text


def test_members_within_members_are_explained_too():
    text = library(controller_export(RLMA, "slip-controller", "wheel"))
    assert (
        "| `command_slip_ratio` | in (-1, 1), > 0 drives and < 0 brakes, in either direction of travel |"
        in text["README.md"]
    )
    assert "float measurement_wheel_speed_rad_s; /* of the wheel, > 0 forward */" in text["wheel.h"]


def test_a_controller_is_small():
    assert size(controller_export(RLMA, "slip-controller")).flash < 4096


def test_what_there_is_not_is_refused():
    with pytest.raises(InputError, match="filter must be one of ekf, aekf, ukf, aukf"):
        observer_export(RLMA, ASPHALT, "kalman")
    with pytest.raises(InputError, match="controller must be one of slip-controller, speed-controller"):
        controller_export(RLMA, "pid")
