"""Messages of the process to the service manager (systemd): it has started, it is alive, it stops.

The protocol of sd_notify(3): datagrams of `KEY=VALUE` lines to the socket that NOTIFY_SOCKET names. The sign of life
comes from the loop that reads the sensors, and only while the estimators accept messages; without it the service
manager restarts the process, which continues from its last snapshot.
"""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Mapping
from contextlib import suppress

from ohmward.onboard.part import LOG
from ohmward.onboard.process import Companion, Process
from ohmward.onboard.robot_state import Level

#: Signs of life per timeout of the service manager: two may be late.
SIGNS = 3

#: Longest time between two status lines, used without a watchdog [s].
STATUS_S = 5.0

#: Messages of one source in a row at which the estimators fail before their state counts as broken.
MOST_FAULTS = 100


class ServiceManager:
    """The service manager that started this process.

    Args:
        address: of its socket; "@..." is in the abstract namespace.
        watchdog_s: time that it waits for a sign of life, None without a watchdog.
    """

    def __init__(self, address: str, watchdog_s: float | None = None):
        self.address = f"\0{address[1:]}" if address.startswith("@") else address
        self.watchdog_s = watchdog_s
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def send(self, **lines: str) -> None:
        """Send lines `KEY=VALUE`, without waiting for a manager that does not listen."""
        text = "\n".join(f"{key}={' '.join(value.split())}" for key, value in lines.items())
        try:
            self._socket.sendto(text.encode(), self.address)
        except OSError as error:
            LOG.debug("the service manager did not take %r (%s)", text, error)


def service_manager(environment: Mapping[str, str] = os.environ) -> ServiceManager | None:
    """The service manager that the environment names, None if there is none."""
    address = environment.get("NOTIFY_SOCKET", "")
    if not address or not hasattr(socket, "AF_UNIX"):
        return None
    ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    wait_us = environment.get("WATCHDOG_USEC", "") if ours else ""
    return ServiceManager(address, 1e-6 * int(wait_us) if wait_us.isdecimal() and int(wait_us) > 0 else None)


def notifying(process: Process, manager: ServiceManager) -> Companion:
    """The task of a process that keeps the service manager informed."""
    interval_s = STATUS_S if manager.watchdog_s is None else min(STATUS_S, manager.watchdog_s / SIGNS)

    async def run() -> None:
        manager.send(READY="1", STATUS=status(process))
        try:
            while not process.stopping.is_set():
                if is_alive(process):
                    manager.send(WATCHDOG="1", STATUS=status(process))
                with suppress(TimeoutError):
                    await asyncio.wait_for(process.stopping.wait(), interval_s)
        finally:
            manager.send(STOPPING="1", STATUS="stopping")
        await asyncio.Event().wait()  # until the process has ended

    return "service manager", run


def is_alive(process: Process) -> bool:
    """True while the estimators take the messages of every source."""
    return max(process.faults.values(), default=0) < MOST_FAULTS


def status(process: Process) -> str:
    """A line for `systemctl status`: charge, and the first condition that is not in order."""
    charge = process.state.battery
    parts = [f"charge {100.0 * charge.soc:.0f} %"] if charge else []
    worse = [found for found in process.diagnostics.values() if found.level != Level.OK]
    parts += [f"{found.name}: {found.message}" for found in worse[:1]] or ["in order"]
    parts += [f"and {len(worse) - 1} more"] if len(worse) > 1 else []
    return ", ".join(parts)
