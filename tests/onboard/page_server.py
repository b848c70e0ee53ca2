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
from ohmward.onboard.store.rows import Row
from ohmward.onboard.store.store import Store
from ohmward.traction.robot.packaged import load_robot

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


NOW_S = drive()[0].unix_s


def stored(folder, hours, every_s=10.0, until_s=NOW_S):
    """Rows of the hours before a time: the charge falls to what it is, the robot drives at 0.5 m/s."""
    store, count = Store(folder), int(3600 * hours / every_s)
    times = [until_s - every_s * (count - k) for k in range(count)]
    battery = {"soc_std": 0.01, "battery_current_A": -2.0, "battery_voltage_V": 13.0, "range_p50_m": 900.0}
    moving = {"estimated_speed_m_s": 0.5, "slip_ratio.front_left": 0.1, "slip_ratio.front_right": -0.3}
    store.add(Row("battery", round(1e9 * t), {"soc": 0.9 - 0.4 * k / count, **battery}) for k, t in enumerate(times))
    store.add(Row("drive", round(1e9 * t), moving) for t in times)
    store.close()


def dashboard_with(folder):
    """The dashboard of a robot whose store is in a folder."""
    dashboard = Dashboard("rover", folder)
    dashboard.take(drive())
    return dashboard


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
