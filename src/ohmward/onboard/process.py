"""The process on the robot: concurrent sources and sinks, with the estimators between them."""

from __future__ import annotations

import asyncio
import errno
import logging
import math
import re
import signal
import sys
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from ohmward.battery.log_check import OTHER_FILE
from ohmward.battery.soc.exchange_watch import ANOTHER_IS_IN
from ohmward.battery.soc.sample import SocEstimate, SocFlag
from ohmward.errors import OhmwardError
from ohmward.onboard.alarms import AlarmLimits, AlarmWatch
from ohmward.onboard.clock import DATED_S, LEAP_S, Arrival, Arrivals, SystemClock
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.evidence import Age, AgeingModel
from ohmward.onboard.feed import Feed
from ohmward.onboard.message import Message
from ohmward.onboard.part import LOG, EndedError, FaultyInput, Sink, Source, feed_interval_s, is_live, keep_running
from ohmward.onboard.robot_state import Diagnostic, Level, RobotState
from ohmward.onboard.sensor_watch import SensorWatch
from ohmward.traction.odometry.sample import OdometryFlag

#: Time between two checks for sensors that should have reported.
SENSOR_LOOK_S = 0.25

#: Time since the last late message after which all come in time, and the delays that are suggested.
ALL_IN_TIME_S, DELAYS_S = 60.0, (0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)

#: Least time between two checks for alarms.
ALARM_LOOK_S = 0.2

#: Longest time between two states; if no sensor reports, a state goes out with new diagnostics.
IDLE_S = 1.0

#: Time between two forecasts of the range; time at first, when little has been driven; change of the charge that
#: triggers a forecast at once.
FORECAST_S, FIRST_FORECAST_S, FORECAST_SOC = 30.0, 3.0, 0.02

#: Time that sinks have at the end to deliver waiting states; the rest stays undelivered or on their own disk.
END_S = 5.0

#: Time after which another thread yields the interpreter [s]; with the default of 5 ms a forecast of the range would
#: delay hundreds of estimates.
SWITCH_S = 0.0005

#: Time for which an exchange of the battery is reported [s].
EXCHANGED_FOR_S = 600.0

#: Time before the recovery of a part is logged [s], if it has not failed again.
RECOVERED_S = 2.0

#: Number of message dates remembered, enough for samples that still wait for others.
DATES = 4096

#: In strict mode a source or sink that fails within this time after the start ends the process.
STRICT_S = 5.0

#: Errors of a connection that cannot be accepted for lack of file handles or memory.
_EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)

#: Name and function of a task that runs beside sources and sinks.
Companion = tuple[str, Callable[[], Awaitable[None]]]

#: A figure in a sentence.
_FIGURE = re.compile(r"-?\d+([.,]\d+)*(e[+-]?\d+)?")
_LOG_LEVELS = {Level.OK: logging.INFO, Level.WARN: logging.WARNING}


class Process:
    """Sources -> estimators -> sinks, until the sources end or somebody stops it.

    Args:
        estimation: the estimators.
        sources, sinks: the parts around them.
        clock: of this machine.
        strict: end with an error if a source or sink cannot start.
        alarms: limits of the alarms.
        companions: other tasks; each is restarted as sources are, and cancelled at the end.

    Attributes:
        state: the last one passed on, with bands as of its time.
        faults: source -> number of its latest messages in a row at which the estimators raised an unexpected error.
        stopping: set once `stop` is called.
    """

    def __init__(
        self,
        estimation: Estimation,
        sources: Sequence[Source],
        sinks: Sequence[Sink],
        clock: SystemClock | None = None,
        strict: bool = False,
        companions: Sequence[Companion] = (),
        alarms: AlarmLimits | None = None,
    ):
        self.estimation, self.sources, self.strict = estimation, sources, strict
        self.clock = clock or SystemClock()
        self.companions = list(companions)
        self.sinks = [(sink, Feed(feed_interval_s(sink))) for sink in sinks]
        for _, feed in self.sinks:
            feed.mission = estimation.mission
        self.diagnostics: dict[str, Diagnostic] = {}
        #: conditions logged of each name: the last recovery, or the faults since then
        self._logged: dict[str, list[tuple[Level, str]]] = {}
        self._own = frozenset(source.name for source in sources if not is_live(source))
        self._restarts, self._suspended_s = 0, self.clock.suspended_s()
        self._restart()
        self._ageing = AgeingModel(estimation.battery, estimation.robot)
        self.state = estimation.state
        self._reported: tuple[Diagnostic, ...] = ()
        self._left_out, self._late_s = 0, -math.inf  # drive messages left out, and when their number last grew
        self._alarms = AlarmWatch(alarms, ALARM_LOOK_S)
        self._passed_s = self.clock.now_s()
        self._began_s = math.inf
        self.faults: Counter[str] = Counter()
        self.stopping, self._hurried = asyncio.Event(), asyncio.Event()
        self._refused = ""
        self._exhausted = FaultyInput("connections", "cannot be taken; who opens so many?", "process")

    async def run(self) -> None:
        """Run until every source has ended or `stop` is called; sinks then deliver waiting states.

        Raises:
            OhmwardError: in strict mode, a source or sink cannot start.
        """
        self._began_s = self.watch.began_s = self.clock.now_s()
        self.stopping, self._hurried = asyncio.Event(), asyncio.Event()
        if not self.sources:
            LOG.warning("no source: nothing comes in; add a [[source]] to the setup")
        if not self.sinks:
            LOG.warning("no sink: nobody gets the estimates; add a [[sink]] to the setup")
        sys.setswitchinterval(SWITCH_S)
        asyncio.get_running_loop().set_exception_handler(self._take_error)
        sinks = [self._begin(f"sink {sink.name}", partial(_deliver, sink, feed)) for sink, feed in self.sinks]
        watch = self._begin("sensors", self._look)
        beside = [
            self._begin("range", self._forecast),
            *(self._begin(name, run) for name, run in self.companions),
        ]
        sources = [self._begin(f"source {source.name}", partial(source.run, self.put)) for source in self.sources]
        stopped, ended = asyncio.create_task(self.stopping.wait()), asyncio.create_task(_all(sources))
        try:
            await asyncio.wait([stopped, ended], return_when=asyncio.FIRST_COMPLETED)
        finally:
            await _cancel([stopped, ended, *sources, watch])  # sources that end now are not reported as silent
            for arrival in self._arrivals.flush():
                self._take(arrival)
            for state in self.estimation.flush():  # as of now, maybe long after the measurement
                self._pass_on(state if self._own else state._replace(time_s=self.now_s()))
            for _, feed in self.sinks:
                feed.end()
            hurried, delivered = asyncio.create_task(self._hurried.wait()), asyncio.create_task(_all(sinks))
            await asyncio.wait([hurried, delivered], timeout=END_S, return_when=asyncio.FIRST_COMPLETED)
            await _cancel([hurried, delivered, *sinks, *beside])
            for sink, feed in self.sinks:
                if feed.waiting:
                    LOG.warning("sink %s: states that were not delivered: %d", sink.name, feed.waiting)
        if self._refused:
            raise OhmwardError(self._refused)

    def now_s(self) -> float:
        """Time on the clock of the states: the machine's clock, or that of a replay or simulation at another rate."""
        return self.clock.now_s() + self._ahead_s if math.isnan(self._simulated_s) else self._simulated_s

    def _restart(self) -> None:
        """Reset all times, at the start and when a simulation or a bag restarts."""
        self._arrivals = Arrivals(self._own)
        self._dates: dict[float, float] = {}  # of recent messages, as their sources gave them, by time
        #: evidence -> time of the last state for which it was overdue, and whether its sensors were silent
        self._overdue: dict[str, tuple[float, bool]] = {}
        self._ahead_s, self._received_s, self._simulated_s = 0.0, -math.inf, math.nan
        self._calendar_s, self._newest_s = math.nan, -math.inf
        promised = {s.name: getattr(s, "signals", ()) for s in self.sources if s.name not in self._own}
        known = self.estimation
        self.watch = SensorWatch(known.battery, known.robot, promised, counts_per_turn=known.counts_per_turn)

    def stop(self) -> None:
        """End the sources; sinks deliver waiting states, and `run` returns. A second call does not wait for sinks."""
        if self.stopping.is_set():
            self._hurried.set()
        self.stopping.set()

    def stop_on_signals(self) -> None:
        """End cleanly on SIGTERM and SIGINT; to be called in the running loop."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            with suppress(NotImplementedError, RuntimeError):  # on Windows; outside the main thread
                loop.add_signal_handler(number, self.stop)

    def put(self, message: Message) -> None:
        """Accept a message: estimate, and pass the states on. Never raises."""
        self._take_time(message)
        for arrival in self._arrivals.put(message):
            self._take(arrival)

    def _take_time(self, message: Message) -> None:
        """Time after a message: a simulation that went back restarts everything, a suspended machine leaves a gap."""
        own = message.source in self._own
        if own and message.received_s < self._received_s - LEAP_S:
            LOG.warning("source %s: its time went back; everything restarts", message.source)
            self.estimation.restart()
            self._restarts += 1
            self._restart()
        slept_s = self.clock.suspended_s() - self._suspended_s
        if slept_s > LEAP_S and not own:
            LOG.warning("this machine was suspended for %.0f s: what the battery did meanwhile is not known", slept_s)
            self._suspended_s += slept_s
            self.estimation.shift_s += slept_s
        ahead_s = message.received_s - self.clock.now_s()
        self._ahead_s = ahead_s if own else max(self._ahead_s, ahead_s)
        if own:
            self._received_s = message.received_s
        if message.sets_time:
            self._simulated_s = message.received_s

    def _take(self, arrival: Arrival) -> None:
        """Estimate from a message, and pass the states on. Never raises."""
        source = arrival.message.source
        try:
            for state in self.estimation.put(arrival.time_s, self._watched(arrival)):
                self._pass_on(state)
            self.faults[source] = 0
        except Exception as error:
            self.faults[source] += 1
            LOG.exception("estimation: unexpected error")
            self.report(Diagnostic("estimation", Level.ERROR, f"unexpected {type(error).__name__}: {error}"))

    def _watched(self, arrival: Arrival) -> dict[str, float]:
        """Values of a message that may be used, with nan for invalid ones."""
        message, time_s, clock_was_set = arrival
        if math.isfinite(message.date_s):
            self._dates[time_s] = message.date_s
            if len(self._dates) > DATES:
                del self._dates[next(iter(self._dates))]
        behind_s = self.clock.unix_s() - (self.clock.now_s() - message.received_s) - message.stamp_s
        if message.source in self._own:
            self._calendar_s, behind_s = message.date_s - time_s, 0.0
        behind_s = behind_s if abs(behind_s) < DATED_S else 0.0
        values = self.watch.take(
            message.source, time_s, message.received_s, message.values, message.publisher, behind_s
        )
        if clock_was_set:
            self.watch.clock_was_set(message.source, message.received_s)
        return values

    def report(self, diagnostic: Diagnostic) -> None:
        """Record a condition; every state carries the latest one of each name. A new one is logged."""
        before = self.diagnostics.get(diagnostic.name)
        self.diagnostics[diagnostic.name] = diagnostic
        self._reported = ()
        if before and _level_and_text(before) == _level_and_text(diagnostic):
            return
        if before and before.level > diagnostic.level == Level.OK:  # most failed parts fail again at once
            asyncio.get_running_loop().call_later(RECOVERED_S, self._log, diagnostic)
        else:
            self._log(diagnostic)
        if self.strict and diagnostic.level == Level.ERROR:
            self._refuse(diagnostic)

    def _log(self, diagnostic: Diagnostic) -> None:
        """Log a condition, unless it has changed meanwhile or is one of the last without a recovery in between."""
        now, logged = _level_and_text(diagnostic), self._logged.setdefault(diagnostic.name, [])
        if now in logged or _level_and_text(self.diagnostics[diagnostic.name]) != now:
            return
        level = logging.DEBUG if not logged and diagnostic.level == Level.OK else _LOG_LEVELS.get(diagnostic.level)
        faults = [one for one in logged if one[0] != Level.OK and diagnostic.level != Level.OK]
        self._logged[diagnostic.name] = [*faults, now]
        LOG.log(level or logging.ERROR, "%s: %s", diagnostic.name, diagnostic.message)

    def _refuse(self, diagnostic: Diagnostic) -> None:
        """End the process if a source or sink has failed at the start."""
        of_part = diagnostic.name.startswith(("source ", "sink "))
        if of_part and self.clock.now_s() - self._began_s < STRICT_S:
            self._refused = self._refused or f"{diagnostic.name}: {diagnostic.message}"
            self.stop()

    def _take_error(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Log an error of the event loop; errors for lack of files, which come in hundreds, only now and then."""
        error = context.get("exception")
        if isinstance(error, OSError) and error.errno in _EXHAUSTED:
            self._exhausted.count(example=str(error.strerror).encode())
        else:
            loop.default_exception_handler(context)

    def _begin(self, name: str, run: Callable[[], Awaitable[None]]) -> asyncio.Task[None]:
        """Start a part, and restart it whenever it ends."""
        return asyncio.create_task(keep_running(name, run, self.report))

    async def _look(self) -> None:
        while True:
            began_s = self.clock.now_s()
            await asyncio.sleep(SENSOR_LOOK_S)
            if self.clock.now_s() - began_s > 2.0 * SENSOR_LOOK_S:
                await asyncio.sleep(SENSOR_LOOK_S)  # held up by the machine: first accept what came meanwhile
            for arrival in self._arrivals.due(self.clock.now_s()):
                self._take(arrival)
            pose = self.estimation.state.pose
            if pose and int(pose.flags) & OdometryFlag.NO_GYRO:
                self.watch.take_contradiction("yaw_rate_rad_s")
            for diagnostic in self.watch.look(self.now_s()):
                self.report(diagnostic)
            for sink, feed in self.sinks:
                self.report(_delivery(sink.name, feed))
            if self.estimation.inbox:
                late, late_s = self.estimation.late, self.estimation.late_s
                if late != self._left_out:
                    self._left_out, self._late_s = late, self.now_s()
                self.report(_lateness(self.now_s() - self._late_s < ALL_IN_TIME_S, late, late_s))
            if charge := self.estimation.state.battery:
                lost = self.estimation.cell_loss.lost if self.estimation.cell_loss else 0
                for diagnostic in _of_battery(charge, self.now_s() - self.estimation.exchanged_s, lost):
                    self.report(diagnostic)
            if self.clock.now_s() - self._passed_s > IDLE_S:
                self._pass_on(self.estimation.state._replace(time_s=self.now_s(), sample={}))

    async def _forecast(self) -> None:
        """Forecast the range: once the charge is known, when it leaps, once the drive informs it, and periodically."""
        made_s, wait_s, soc, assumed = -math.inf, FIRST_FORECAST_S, math.nan, True
        while True:
            await asyncio.sleep(SENSOR_LOOK_S)
            charge = self.estimation.state.battery
            if charge is None or (compute := self.estimation.forecast()) is None:
                continue
            due = not 0.0 <= self.now_s() - made_s <= wait_s
            reach = self.estimation.state.range
            first_known = assumed and reach is not None and not reach.assumed
            if due or first_known or abs(charge.soc - soc) > FORECAST_SOC:
                wait_s = min(2.0 * wait_s, FORECAST_S) if due else wait_s
                made_s, soc, assumed = self.now_s(), charge.soc, assumed and not first_known
                self.estimation.take_forecast(await asyncio.to_thread(compute))

    def _pass_on(self, state: RobotState) -> None:
        """Pass a state on as of its time, or of the newest one before it: a late sample is no step back in time."""
        self._passed_s, self._newest_s = self.clock.now_s(), max(self._newest_s, state.time_s)
        state = state._replace(time_s=self._newest_s)
        behind_s = max(-self._ahead_s, 0.0)  # a simulation that is too slow shows its own time
        unix_s = self.clock.unix_s() - (self._passed_s - behind_s - state.time_s)
        if math.isfinite(self._calendar_s):
            unix_s = state.time_s + self._calendar_s
        self._reported = self._reported or tuple(self.diagnostics.values())
        aged = self._ageing.aged(state, self._ages(state), self.estimation.last_current_A)
        self.state = aged._replace(
            unix_s=unix_s,
            battery_unix_s=self._dates.get(state.battery_time_s, unix_s - (state.time_s - state.battery_time_s)),
            drive_unix_s=self._dates.get(state.drive_time_s, unix_s - (state.time_s - state.drive_time_s)),
            diagnostics=self._reported,
            restarts=self._restarts,
        )
        self.state = self.state._replace(alarms=self._alarms.take(self.state))
        for _, feed in self.sinks:
            feed.put(self.state)

    def _ages(self, state: RobotState) -> dict[str, Age]:
        """Overdue evidence of a state; an estimate from before a silence stays it once its sensors report again."""
        ages = self.watch.ages(state.time_s)
        self._overdue |= {name: (state.time_s, age.silent) for name, age in ages.items()}
        for name, (overdue_s, silent) in self._overdue.items():
            estimated_s = getattr(state, f"{name}_time_s")
            if name not in ages and estimated_s <= overdue_s:
                ages[name] = Age(state.time_s - estimated_s, silent)
        return ages


def _level_and_text(diagnostic: Diagnostic) -> tuple[Level, str]:
    """Level and sentence of a condition, without its figures."""
    return diagnostic.level, _FIGURE.sub("#", diagnostic.message)


def _lateness(is_late: bool, left_out: int, late_s: float) -> Diagnostic:
    """Condition of the order of drive messages; left_out: number since the start.  late_s: largest lateness so far."""
    figures = {"left_out": float(left_out), "late_s": late_s}
    if not is_late:
        return Diagnostic("order of messages", Level.OK, "in time", figures)
    delay_s = next((delay_s for delay_s in DELAYS_S if delay_s >= late_s), DELAYS_S[-1])
    fix = f"delay_s = {delay_s:g} would do" if late_s else "their clock is another one"
    message = f"come later than others of a later time and are left out; {fix}, or look at their link"
    return Diagnostic("order of messages", Level.WARN, message, figures)


def _delivery(name: str, feed: Feed) -> Diagnostic:
    """Condition of the delivery to a running sink."""
    if feed.trouble:
        return Diagnostic(f"delivery to {name}", Level.ERROR, feed.trouble)
    if feed.lost:
        message = "too slow: states were left out; raise its interval_s, or look at what it writes to"
        return Diagnostic(f"delivery to {name}", Level.WARN, message, {"lost": float(feed.lost)})
    return Diagnostic(f"delivery to {name}", Level.OK, "in time")


def _of_battery(charge: SocEstimate, exchanged_ago_s: float, lost: int) -> Iterator[Diagnostic]:
    """Conditions of the battery: whether its file can be right, another battery is in, or cells have gone."""
    if int(charge.flags) & SocFlag.MISFIT:
        message = (
            f"does not fit the measurements: it asks for a sensor off by {float(charge.current_offset_A):.3g} A and a "
            f"capacity of {float(charge.soh_capacity):.0%}; {OTHER_FILE}"
        )
        yield Diagnostic("battery file", Level.WARN, message)
    else:
        yield Diagnostic("battery file", Level.OK, "fits the measurements")
    if exchanged_ago_s > EXCHANGED_FOR_S:
        yield Diagnostic("battery exchange", Level.OK, "none")
    else:
        yield Diagnostic("battery exchange", Level.WARN, f"{ANOTHER_IS_IN}; battery_changed = 1 says so at once")
    if lost:
        message = (
            f"the voltage fell at once by that of {lost}: a cell is shorted, or a wire to it has come off; stop "
            "charging and look at it. The charge is estimated from the other cells"
        )
        yield Diagnostic("cells in series", Level.ERROR, message, {"lost": float(lost)})
    else:
        yield Diagnostic("cells in series", Level.OK, "all there")


async def _deliver(sink: Sink, feed: Feed) -> None:
    """Run a sink to the end of its feed."""
    await sink.run(feed)
    if feed.ended:
        raise EndedError("delivered to the end")


async def _cancel(tasks: Sequence[asyncio.Task[object]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _all(tasks: Sequence[asyncio.Task[None]]) -> None:
    """Wait until all tasks have ended."""
    for task in tasks:
        await asyncio.wait([task])
