"""A package that is missing is one line that names what to install."""

import os
import re
import sys
import tomllib
from pathlib import Path

import pytest
import threadpoolctl

import ohmward
from ohmward.errors import OhmwardError
from ohmward.optional import MissingPackageError, one_blas_thread, require, silenced

SOURCE = Path(ohmward.__file__).parent
PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"


def test_a_package_that_is_there_is_imported():
    assert require("json.decoder", "this test").JSONDecoder


@pytest.mark.parametrize(
    ("module", "package"),
    [("scipy.optimize", "scipy"), ("tomli_w", "tomli-w"), ("zenoh", "eclipse-zenoh"), ("foxglove", "foxglove-sdk")],
)
def test_a_package_that_is_missing_is_named_as_on_the_index(module, package, monkeypatch):
    monkeypatch.setitem(sys.modules, module.partition(".")[0], None)
    line = f"this test needs {package}, which is not installed: pip install {package}"
    with pytest.raises(MissingPackageError, match=re.escape(line)):
        require(module, "this test")
    assert issubclass(MissingPackageError, OhmwardError)


def test_packages_that_go_together_are_asked_for_at_once(monkeypatch):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    line = "the page needs starlette and uvicorn, which are not installed: pip install starlette uvicorn"
    with pytest.raises(MissingPackageError, match=line):
        require("uvicorn", "the page")


def test_ros_itself_has_two_ways_to_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(MissingPackageError, match=r"needs rclpy, which comes with ROS 2: source /opt/ros/") as raised:
        require("rclpy.context", "this test")
    extra = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]["optional-dependencies"]["rclpy"]
    told = str(raised.value).partition("pip install ")[2].replace("'", "").split()
    assert told == [requirement.partition("~")[0] for requirement in extra]


def test_no_message_names_an_extra_of_a_package_that_is_not_on_the_index():
    texts = {path: path.read_text(encoding="utf-8") for path in SOURCE.rglob("*.py")}
    assert [str(path) for path, text in texts.items() if "ohmward[" in text] == []


def test_what_a_package_and_its_c_print_is_kept_off_the_standard_streams(capfd):
    with silenced():
        print("a remark")
        print("a fault", file=sys.stderr)
        os.write(2, b"a fault of C")
    print("a result", file=sys.stderr)
    assert capfd.readouterr() == ("", "a result\n")


def test_blas_keeps_to_one_thread_and_gets_its_own_back():
    before = [pool["num_threads"] for pool in threadpoolctl.threadpool_info()]
    with one_blas_thread():
        assert {pool["num_threads"] for pool in threadpoolctl.threadpool_info()} <= {1}
    assert [pool["num_threads"] for pool in threadpoolctl.threadpool_info()] == before


def test_without_threadpoolctl_blas_is_left_alone(monkeypatch):
    monkeypatch.setitem(sys.modules, "threadpoolctl", None)
    with one_blas_thread() as limits:
        assert limits is None
