"""Real servers for tests, on free ports of this machine."""

import atexit
import contextlib
import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import urllib.parse
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for_port(port: int, within_s: float = 60.0) -> None:
    end_s = time.monotonic() + within_s
    while time.monotonic() < end_s:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 0.2):
            return
        time.sleep(0.02)
    raise AssertionError(f"nothing listens on port {port}")


class Mosquitto:
    """A broker that can be stopped and started again."""

    def __init__(self, folder: Path, *settings: str):
        program = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
        if program is None:
            pytest.skip("mosquitto is not installed")
        self.port, self._program = free_port(), program
        self._process: subprocess.Popen[bytes] | None = None
        self.log = folder / "mosquitto.log"
        self._settings = folder / "mosquitto.conf"
        lines = [f"listener {self.port} 127.0.0.1", "user root", *(settings or ["allow_anonymous true"])]
        self._settings.write_text("\n".join(lines) + "\n")

    def start(self) -> None:
        with self.log.open("a") as log:
            self._process = subprocess.Popen(
                [self._program, "-c", str(self._settings)], stdout=log, stderr=subprocess.STDOUT
            )
        wait_for_port(self.port)

    def stop(self) -> None:
        if self._process:
            self._process.terminate()
            self._process.wait(10)
            self._process = None


@contextlib.contextmanager
def mosquitto(folder: Path, *settings: str) -> Iterator[Mosquitto]:
    broker = Mosquitto(folder, *settings)
    broker.start()
    try:
        yield broker
    finally:
        broker.stop()


#: A server that takes longer to start is broken [s].
START_S = 30.0


@contextlib.contextmanager
def started(
    command: list[str], port: int, log: Path, end: int = signal.SIGKILL, **options: Any
) -> Iterator[subprocess.Popen[bytes]]:
    """A server that listens on a port; it gets the signal `end` at the end, and is killed by default."""
    with log.open("ab") as out:
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, **options)
        try:
            wait_for_port(port, START_S)
            yield process
        finally:
            process.send_signal(end)
            process.wait(30)


def program(name: str, *folders: str) -> str:
    """Path of a server's program; the test is skipped where it is not installed."""
    found = shutil.which(name) or next((p for folder in folders if (p := shutil.which(name, path=folder))), None)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


@contextlib.contextmanager
def victoria_metrics(folder: Path, port: int) -> Iterator[str]:
    """Address of a VictoriaMetrics with its data in a folder."""
    command = [program("victoria-metrics"), f"-storageDataPath={folder / 'vm'}", f"-httpListenAddr=127.0.0.1:{port}"]
    with started([*command, "-retentionPeriod=100y"], port, folder / "vm.log"):
        yield f"http://127.0.0.1:{port}"


@contextlib.contextmanager
def influxdb(folder: Path, port: int) -> Iterator[str]:
    """Address of an InfluxDB with the database `robots` in a folder."""
    settings = folder / "influx.conf"
    settings.write_text(
        f'reporting-disabled = true\nbind-address = "127.0.0.1:{free_port()}"\n'
        f'[meta]\n dir = "{folder}/meta"\n[data]\n dir = "{folder}/data"\n wal-dir = "{folder}/wal"\n'
        f'[http]\n bind-address = "127.0.0.1:{port}"\n'
    )
    with started([program("influxd"), "-config", str(settings)], port, folder / "influx.log"):
        query = urllib.parse.urlencode({"q": "CREATE DATABASE robots"}).encode()
        urllib.request.urlopen(f"http://127.0.0.1:{port}/query", query, timeout=60).read()
        yield f"http://127.0.0.1:{port}"


@contextlib.contextmanager
def postgresql(folder: Path, port: int) -> Iterator[str]:
    """Connection string of a PostgreSQL with its data in a folder, which goes on where it stopped."""
    places = [str(path) for path in sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)]
    initdb, server = program("initdb", *places), program("postgres", *places)
    options: dict[str, Any] = {}
    data = folder / "pg"
    if os.geteuid() == 0:  # it refuses to run as root, whose folders pytest closes to others whenever one begins
        user = pwd.getpwnam("postgres")
        options = {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
        if not data.exists():
            own = tempfile.mkdtemp(prefix="ohmward-pg-")
            atexit.register(shutil.rmtree, own, ignore_errors=True)
            os.chown(own, user.pw_uid, user.pw_gid)
            data.symlink_to(own)
        data = data.resolve()
    if not (data / "PG_VERSION").exists():
        command = [initdb, "-D", str(data), "-A", "trust", "-U", "rover", "-N"]
        done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
        assert done.returncode == 0, done.stderr
    command = [
        server,
        "-D",
        str(data),
        "-p",
        str(port),
        "-c",
        "listen_addresses=127.0.0.1",
        "-c",
        "unix_socket_directories=",
    ]
    with started(command, port, folder / "pg.log", end=signal.SIGQUIT, **options):  # at once, with its children
        ready = [program("pg_isready", *places), "-h", "127.0.0.1", "-p", str(port), "-t", "1"]
        until_s = time.monotonic() + START_S
        while subprocess.run(ready, capture_output=True, check=False).returncode != 0:
            assert time.monotonic() < until_s, (folder / "pg.log").read_text()
            time.sleep(0.1)
        yield f"host=127.0.0.1 port={port} dbname=postgres user=rover"
