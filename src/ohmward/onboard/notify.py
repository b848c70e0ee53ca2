"""Messages of the process to the service manager (systemd): it has started, it lives, it stops.

The protocol of sd_notify(3): datagrams of `KEY=VALUE` lines to the socket that NOTIFY_SOCKET names. The sign of life
comes from the loop that the sensors are read in, and only while the estimators take what comes; where it stays away
the service manager starts the process anew, which goes on from its last snapshot.
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

#: Signs of life per time that the service manager waits for one: two may be late.
SIGNS = 3

#: Time between two status lines where nobody waits for signs of life [s].
STATUS_S = 5.0

#: So many messages of one source in a row that the estimators fail at are no mishap: their state is broken.
MOST_FAULTS = 100


class ServiceManager:
    """The service manager that started this process.

    Args:
        address: of its socket; "@..." is one of the abstract namespace.
        watchdog_s: it waits so long for a sign of life, None where it does not.
    """

    def __init__(self, address: str, watchdog_s: float | None = None):
        self.address = f"\0{address[1:]}" if address.startswith("@") else address
        self.watchdog_s = watchdog_s
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def send(self, **lines: str) -> None:
        """Send lines `KEY=VALUE`. A manager that does not listen is not waited for."""
        text = "\n".join(f"{key}={' '.join(value.split())}" for key, value in lines.items())
        try:
            self._socket.sendto(text.encode(), self.address)
        except OSError as error:
            LOG.debug("the service manager did not take %r (%s)", text, error)


def service_manager(environment: Mapping[str, str] = os.environ) -> ServiceManager | None:
    """The service manager that the environment names, None where there is none."""
    address = environment.get("NOTIFY_SOCKET", "")
    if not address or not hasattr(socket, "AF_UNIX"):
        return None
    ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    wait_us = environment.get("WATCHDOG_USEC", "") if ours else ""
    return ServiceManager(address, 1e-6 * int(wait_us) if wait_us.isdecimal() and int(wait_us) > 0 else None)


def notifying(process: Process, manager: ServiceManager) -> Companion:
    """The part of a process that tells the service manager of it."""
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
        await asyncio.Event().wait()  # until the process is through

    return "service manager", run


def is_alive(process: Process) -> bool:
    """True while the estimators take the messages of every source."""
    return max(process.faults.values(), default=0) < MOST_FAULTS


def status(process: Process) -> str:
    """A line for `systemctl status`: charge, and what is not in order."""
    charge = process.state.battery
    parts = [f"charge {100.0 * charge.soc:.0f} %"] if charge else []
    worse = [found for found in process.diagnostics.values() if found.level != Level.OK]
    parts += [f"{found.name}: {found.message}" for found in worse[:1]] or ["in order"]
    parts += [f"and {len(worse) - 1} more"] if len(worse) > 1 else []
    return ", ".join(parts)
