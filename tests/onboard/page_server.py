"""States of a simulated robot and a server of the live page with them, for its tests."""

import asyncio
import threading
from contextlib import contextmanager
from functools import cache

from ohmward.battery.chemistries import generic_battery
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.page.dashboard import Dashboard
from ohmward.onboard.robot_state import Diagnostic, Level, RobotState
from ohmward.onboard.sinks.page import PageSink
from ohmward.traction.robot.file import load_robot

DIAGNOSTICS = (
    Diagnostic("source can0", Level.OK, "running"),
    Diagnostic("battery_voltage_V", Level.WARN, 'reads 99 now and then; "look" at its wire\nand <b>more</b>'),
)


@cache
def drive(steps: int = 40) -> tuple[RobotState, ...]:
    """States of a robot that drives ahead on a battery half full, with one warning."""
    estimation = Estimation(generic_battery("lfp", 12.0, 4), load_robot("rlma"))
    names = ("front_left", "front_right", "rear_left", "rear_right")
    found: list[RobotState] = []
    for k in range(steps):
        time_s = 0.1 * k
        values = {"battery_current_A": -3.0, "battery_voltage_V": 13.2, "battery_temperature_degC": 21.0}
        found += estimation.put(time_s, values)
        speeds = {f"wheel_speed_rad_s.{name}": 5.0 for name in names}
        currents = {f"motor_current_A.{name}": 0.8 for name in names[:2]}
        found += estimation.put(time_s, speeds | currents | {"yaw_rate_rad_s": 0.1})
    return tuple(state._replace(unix_s=1.8e9 + state.time_s, diagnostics=DIAGNOSTICS) for state in found)


TOKEN = "a token of the robot"


def filled_dashboard() -> Dashboard:
    dashboard = Dashboard("rover <1>")
    dashboard.take(drive())
    return dashboard


@contextmanager
def served(token="", dashboard=None, **settings):
    """Address of a server of the page in a thread of its own."""
    sink = PageSink(port=0, token="OHMWARD_TEST_TOKEN" if token else None, **settings)
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    dashboard = dashboard or asyncio.run_coroutine_threadsafe(_dashboard(), loop).result()
    with sink._listening() as listener:
        server = sink._server(dashboard)
        done = asyncio.run_coroutine_threadsafe(server.serve(sockets=[listener]), loop)
        try:
            yield sink._address(listener)
        finally:
            loop.call_soon_threadsafe(dashboard.end)
            server.should_exit = True
            done.result(10)
            loop.call_soon_threadsafe(loop.stop)
            thread.join(10)
            loop.close()


async def _dashboard():
    return filled_dashboard()
