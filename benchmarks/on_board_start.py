"""Time from the start of `ohmward run` until it tells the service manager that it is ready."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ohmward import generic_battery, save_battery

SETUP = """
format = "ohmward-setup/1"
battery = "battery.toml"
robot = "rlma"
[[source]]
kind = "json-lines"
address = "sensors"
listen = true
[[sink]]
kind = "page"
port = 0
[[sink]]
kind = "store"
"""


def starts(number: int) -> list[float]:
    """Times [s] of so many starts; the first one finds nothing compiled."""
    with tempfile.TemporaryDirectory() as folder:
        save_battery(generic_battery("lfp", 12.0, 4), f"{folder}/battery.toml")
        Path(f"{folder}/robot.toml").write_text(SETUP)
        return [start(folder) for _ in range(number)]


def start(folder: str) -> float:
    """One start: battery, robot, page, store and a source; then it is stopped."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(f"{folder}/notify")
        manager.settimeout(60.0)
        environment = {**os.environ, "NOTIFY_SOCKET": f"{folder}/notify", "OHMWARD_CACHE": f"{folder}/cache"}
        words = [sys.executable, "-m", "ohmward", "run", "robot.toml"]
        began_s = time.monotonic()
        process = subprocess.Popen(words, cwd=folder, env=environment, stderr=subprocess.DEVNULL)
        try:
            while b"READY=1" not in manager.recv(4096):
                pass
            took_s = time.monotonic() - began_s
        finally:
            process.terminate()
            process.wait(30.0)
    Path(f"{folder}/notify").unlink()
    return took_s
