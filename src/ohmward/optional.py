"""Optional packages: imported where they are used, and named in the error where they are missing."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any

from ohmward.errors import OhmwardError

#: Packages whose name on the package index differs from their import name, and those that need another one.
_ON_THE_INDEX = {
    "tomli_w": "tomli-w",
    "can": "python-can",
    "serial": "pyserial",
    "paho": "paho-mqtt",
    "zenoh": "eclipse-zenoh",
    "foxglove": "foxglove-sdk",
    "psycopg": "psycopg[binary]",
    "python_calamine": "python-calamine",
    "starlette": "starlette uvicorn",
    "uvicorn": "starlette uvicorn",
}

#: Packages that usually come with other software, and how to get them.
_ELSEWHERE = {
    "rclpy": "comes with ROS 2: source /opt/ros/DISTRO/setup.bash in the shell that starts ohmward; without ROS, on "
    "Linux and x86-64: pip install 'ros-rclpy[fastrtps]' ros-std-srvs ros-sensor-msgs ros-nav-msgs "
    "ros-geometry-msgs ros-diagnostic-msgs",
    "tf2_msgs": "comes with ROS 2 alone: apt install ros-DISTRO-tf2-msgs and source /opt/ros/DISTRO/setup.bash, or use "
    'transport = "zenoh"',
}


class MissingPackageError(OhmwardError):
    """A package is not installed; the message says which, what needs it, and how to install it."""


def require(module: str, user: str) -> Any:
    """Import a module of an optional package.

    module: its full name, "scipy.optimize".
    user: subject of the message, "identification".

    Raises:
        MissingPackageError: "identification needs scipy, which is not installed: pip install scipy".
    """
    name = module.partition(".")[0]
    try:
        import_module(name)
        return import_module(module)
    except ImportError as error:
        if name in _ELSEWHERE:
            raise MissingPackageError(f"{user} needs {name}, which {_ELSEWHERE[name]}") from error
        package = _ON_THE_INDEX.get(name, name)
        command = f"pip install '{package}'" if "[" in package else f"pip install {package}"
        verb = "are" if " " in package else "is"
        raise MissingPackageError(
            f"{user} needs {package.replace(' ', ' and ')}, which {verb} not installed: {command}"
        ) from error


@contextmanager
def silenced() -> Iterator[None]:
    """Keep the output of a package off standard output and standard error, which carry results and errors.

    On standard error this also silences its C code, and other threads in the meantime.
    """
    with Path(os.devnull).open("w") as nothing, redirect_stdout(nothing), redirect_stderr(nothing):
        try:
            before = os.dup(2)
        except OSError:  # a process without standard error
            yield
            return
        os.dup2(nothing.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(before, 2)
            os.close(before)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Keep BLAS on one thread: on small matrices its threads wait for each other and take ten times as long."""
    try:
        from threadpoolctl import threadpool_limits
    except ImportError:
        yield
        return
    with threadpool_limits(1):
        yield
