import asyncio
import errno
import itertools
import math
import time
from dataclasses import dataclass, field

import numpy as np
import pytest

from ohmward import generic_battery
from ohmward.errors import OhmwardError
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.message import Message
from ohmward.onboard.notify import status
from ohmward.onboard.page.metrics import metrics
from ohmward.onboard.page.view import HISTORY, history_row, view
from ohmward.onboard.part import EndedError
from ohmward.onboard.process import END_S, Process
from ohmward.onboard.robot_state import Diagnostic, Level, plain_state
from ohmward.onboard.sinks.mqtt import MqttSink
from ohmward.onboard.sinks.terminal import line_of
from ohmward.onboard.sources.simulation import SimulationSource
from ohmward.onboard.state_folder import StateFolder
from ohmward.onboard.store.rows import columns_of
from ohmward.traction.robot.packaged import load_robot
from onboard.clocks import FakeClock


@dataclass
class Script:
    """A source that puts what it is given and then ends, stays or fails."""

    messages: list
    name: str = "script"
    then: BaseException | None = None
    runs: int = 0
    live: bool = True

    async def run(self, put):
        self.runs += 1
        for message in self.messages:
            put(message)
        if self.then is not None:
            raise self.then
        await asyncio.sleep(math.inf)


@dataclass
class Collector:
    """A sink that keeps what it gets."""

    name: str = "collector"
    interval_s: float = 0.0
    states: list = field(default_factory=list)

    async def run(self, feed):
        while states := await feed.batch():
            self.states += states


def samples(count, source="script"):
    values = {"battery_current_A": -1.0, "battery_voltage_V": 12.6}
    return [Message(0.1 * k, 100.0 + 0.1 * k, source, values) for k in range(count)]


@pytest.fixture(scope="module")
def battery():
    return generic_battery("lfp", 10.0, 4)


def run(process, seconds=None, until=None):
    async def stop_when_done():
        while not until():
            await asyncio.sleep(0.02)
        process.stop()

    async def main():
        if seconds is not None:
            asyncio.get_running_loop().call_later(seconds, process.stop)
        stopping = asyncio.ensure_future(stop_when_done()) if until else None
        await asyncio.wait_for(process.run(), 60.0)
        if stopping:
            stopping.cancel()

    asyncio.run(main())


def test_every_sample_reaches_every_sink_and_the_process_ends_with_its_sources(battery):
    sinks = [Collector(), Collector("slow", 0.5)]
    run(Process(Estimation(battery), [Script(samples(20), then=EndedError("done"))], sinks))
    assert len(sinks[0].states) == 20
    assert [state.time_s for state in sinks[0].states] == pytest.approx([100.0 + 0.1 * k for k in range(20)])
    assert len(sinks[1].states) == 4


def test_stop_ends_sources_and_delivers_what_waits(battery):
    source, sink = Script(samples(20)), Collector()
    run(Process(Estimation(battery), [source], [sink]), seconds=0.2)
    assert len(sink.states) == 20


def test_what_waits_for_other_messages_is_estimated_at_the_end(battery):
    messages = [*samples(3), Message(0.3, 100.3, "script", {"battery_current_A": -1.0})]
    sink = Collector()
    run(Process(Estimation(battery), [Script(messages, then=EndedError("done"))], [sink]))
    assert len(sink.states) == 4


def test_a_sample_that_waited_through_a_silence_is_no_step_back_in_time(battery):
    """The last message of the drives is of the gyro alone, whose sample ends with the next one."""
    now_s = time.monotonic() - 9.0
    messages = [Message(math.nan, now_s + 0.1 * k, "script", moving(PACK, k)) for k in range(80)]
    for k in (*range(20), 70):
        messages.append(Message(math.nan, now_s + 0.1 * k + 0.01, "script", moving(WHEELS, k)))
    messages.append(Message(math.nan, now_s + 1.95, "script", {"yaw_rate_rad_s": 0.1}))
    messages.sort(key=lambda message: message.received_s)
    sink = Collector()
    run(Process(Estimation(battery, load_robot("rlma")), [Script(messages, then=EndedError("done"))], [sink]))
    times_s = [state.time_s for state in sink.states]
    assert times_s == sorted(times_s)
    assert min(np.diff([state.unix_s for state in sink.states])) > -0.1


def test_the_last_state_is_as_of_now_however_old_what_waited_is(battery):
    """A wheel is silent, then the current alone comes once, and nothing for long: the speed is not shown again."""
    now_s = time.monotonic()
    messages = [Message(math.nan, now_s - 9.0 + 0.1 * k, "script", moving(PACK | WHEELS, k)) for k in range(30)]
    messages.append(Message(math.nan, now_s - 5.9, "script", {"battery_current_A": -1.0}))
    sink = Collector()
    run(
        Process(Estimation(battery, load_robot("rlma")), [Script(messages)], [sink]),
        until=lambda: sink.states and len(sink.states[-1].silent) > 1,
    )
    assert {"battery", "drive"} <= set(sink.states[-1].silent)
    assert sink.states[-1].slip is None


def test_an_estimate_from_before_a_silence_is_not_shown_as_new_when_its_sensors_report_again(battery):
    """After so long a silence the first message of the drive waits for the next: a clock may have been set."""
    process = Process(Estimation(battery, load_robot("rlma")), [SimulationSource(name="script")], [])
    silent, back = np.arange(5.0, 70.0), np.arange(70.0, 72.0, 0.1)
    speed_std_m_s = {}
    for k, time_s in enumerate([*np.arange(0.0, 5.0, 0.1), *silent, *back]):
        values = moving(PACK, k) | ({} if time_s in silent else moving(WHEELS, k))
        process.put(Message(time_s, time_s, "script", values))
        slip = process.state.slip
        speed_std_m_s[time_s] = slip.speed_std_m_s if slip else math.inf
    assert speed_std_m_s[silent[-1]] == speed_std_m_s[back[0]] == math.inf
    assert speed_std_m_s[back[-1]] < 0.1


def test_a_source_that_fails_is_named_and_begins_again(battery):
    source, sink = Script(samples(1), then=OhmwardError("nobody there; plug it in")), Collector()
    process = Process(Estimation(battery), [source], [sink])
    run(process, until=lambda: source.runs == 2)
    diagnostic = process.diagnostics["source script"]
    assert (diagnostic.level, diagnostic.message) == (Level.ERROR, "nobody there; plug it in")


def test_strict_refuses_a_source_that_cannot_begin(battery):
    broken = Script([], then=OhmwardError("no such device; plug it in"))
    process = Process(Estimation(battery), [broken, Script(samples(1), "other")], [Collector()], strict=True)
    with pytest.raises(OhmwardError, match="source script: no such device; plug it in"):
        run(process)


def test_an_unexpected_error_ends_neither_source_nor_process(battery):
    source = Script(samples(2), then=ZeroDivisionError("a defect"))
    process = Process(Estimation(battery), [source], [Collector()])
    run(process, until=lambda: "source script" in process.diagnostics)
    assert "ZeroDivisionError" in process.diagnostics["source script"].message


@pytest.mark.parametrize(("current_A", "level"), [(0.0, Level.OK), (6.0, Level.WARN)])
def test_a_battery_file_that_does_not_fit_is_named(battery, current_A, level):
    """Six amperes for hours, and the voltage of a battery at rest."""
    noise = np.random.default_rng(5).normal(size=(1000, 2))
    script = [
        Message(30.0 * k, 100.0 + 30.0 * k, "script", {"battery_current_A": a, "battery_voltage_V": v})
        for k, (a, v) in enumerate(noise * [0.02, 0.002] + [current_A, 13.2])
    ]
    collector, estimation = Collector(), Estimation(battery)
    estimation.compile()

    def level_at_the_end():
        over = [state for state in collector.states[-1:] if state.battery_time_s >= script[-1].received_s]
        return next((d.level for state in over for d in state.diagnostics if d.name == "battery file"), None)

    run(Process(estimation, [Script(script)], [collector]), until=lambda: level_at_the_end() == level)
    assert level_at_the_end() == level


def test_states_go_on_while_no_sensor_reports(battery):
    sink = Collector()
    run(Process(Estimation(battery), [Script(samples(1))], [sink]), until=lambda: len(sink.states) > 1)
    first, *later = sink.states
    assert later[-1].battery_time_s == first.battery_time_s
    assert later[-1].time_s != first.time_s
    assert later[-1].sample == {}


def test_a_queue_at_the_connection_counts_as_if_it_had_come_in_time(battery):
    """Twenty seconds that were waiting come at once, the next ten as they are measured."""

    def driven(wait_s):
        sent = [
            Message(0.1 * k, 100.0 + max(0.1 * k, wait_s) + 1e-5 * k, "script", moving(PACK | WHEELS, k))
            for k in range(300)
        ]
        process = Process(Estimation(battery, load_robot("rlma")), [Script(sent, then=EndedError("done"))], [])
        run(process)
        assert [d for d in process.diagnostics if d.startswith("clock")] == []
        return process.estimation.totals

    assert driven(20.0) == pytest.approx(driven(0.0), rel=1e-3)


PACK = {"battery_current_A": -1.0, "battery_voltage_V": 12.6}
WHEELS = dict.fromkeys((f"wheel_speed_rad_s.{k}" for k in range(4)), 5.0) | {"yaw_rate_rad_s": 0.0}
CELLS = {f"cell_voltage_V.{k}": 3.15 for k in range(4)}


def moving(values, k):
    """Values that are never the same twice in a row, as those of a sensor that works."""
    return {name: value + 1e-3 * (-1) ** k for name, value in values.items()}


#: Estimates that each kind of silence ages: those with a band that grows, and those that are unknown at once.
SILENCES = [
    (PACK | WHEELS | CELLS, {"battery", "cells"}, {"slip", "pose"}),
    (PACK | CELLS, {"battery", "cells"}, set()),
    (CELLS, {"cells"}, set()),
    ({"battery_current_A": 0.0}, set(), set()),
    ({name: 0.0 for name in WHEELS if name != "yaw_rate_rad_s"}, set(), {"slip", "pose"}),
]


@pytest.mark.parametrize(("silent", "grown", "unknown"), SILENCES)
@pytest.mark.parametrize("how", ["nothing", "no number"])
def test_estimates_whose_sensors_tell_nothing_age_in_what_is_passed_on(battery, silent, grown, unknown, how):
    """Ten samples a second: called silent after more than a second of silence, or of nan, and not before."""
    collector = Collector()
    process = Process(Estimation(battery, load_robot("rlma")), [Script([])], [collector])
    values = PACK | WHEELS | CELLS
    for k in range(60):
        told = {name: v for name, v in moving(values, k).items() if k < 40 or name not in silent}
        if k >= 40 and how == "no number":
            told |= dict.fromkeys(silent, math.nan)
        process.put(Message(math.nan, 100.0 + 0.1 * k, "script", told | {"battery_temperature_degC": 20.0 + 0.1 * k}))
        process._pass_on(process.estimation.state._replace(time_s=100.0 + 0.1 * k))
        if k == 45:
            assert process.state.silent == ()
            assert None not in (process.state.battery, process.state.cells, process.state.slip, process.state.pose)
    fresh, state = process.estimation.state, process.state
    assert {name for name in ("battery", "cells", "slip", "pose") if getattr(state, name) is None} == unknown
    stds = {"battery": lambda s: s.battery.soc_std, "cells": lambda s: s.cells.pack.soc_std}
    assert {name for name, std in stds.items() if std(state) > std(fresh)} == grown
    assert set(state.silent) == grown | ({"drive"} if unknown else set())
    if "drive" in state.silent and "battery" in state.silent:
        assert state.battery_time_s == state.drive_time_s == state.cells_time_s == pytest.approx(103.9)


def silent_for(process, age_s):
    """What is passed on so long after the last message."""
    process._pass_on(process.estimation.state._replace(time_s=104.0 + age_s, sample={}))
    return process.state


def test_estimates_come_back_with_their_sensors(battery):
    process = Process(Estimation(battery), [Script([])], [])
    for time_s in (*np.arange(100.0, 104.0, 0.1), *np.arange(120.0, 121.0, 0.1)):
        process.put(Message(math.nan, time_s, "script", moving(PACK, round(10 * time_s))))
        if time_s < 104.0:
            process._pass_on(process.estimation.state._replace(time_s=time_s + 6.0))
            assert process.state.silent == ("battery",)
    assert process.state.silent == ()
    assert process.state.battery == process.estimation.state.battery


def test_every_sink_shows_a_dash_for_what_is_unknown(battery):
    """JSON, MQTT, the page, its metrics and history, the terminal and the status of the service."""
    process = Process(Estimation(battery, load_robot("rlma")), [Script([])], [])
    for k in range(40):
        process.put(Message(math.nan, 100.0 + 0.1 * k, "script", moving(PACK | WHEELS, k)))
    shown = [process.state, silent_for(process, 36_000.0)]
    known, unknown = (_shown(state, process) for state in shown)
    assert all(value is not None for value in known.values())
    assert unknown == dict.fromkeys(known)
    sentence = "stale: no news from the sensors of the battery for 600 min and of the wheels for 600 min"
    assert sentence in line_of(shown[1])
    assert 'ohmward_drive_sample_age_seconds{robot="rover"} 36000.1' in metrics({"name": "rover", **view(shown[1])})


def _shown(state, process):
    """Numbers of a state in every sink, None where it is not shown."""
    seen, plain = view(state), plain_state(state)
    process.state = state
    topics = dict(MqttSink(numbers=("battery.soc", "slip.speed_m_s", "pose.x_m")).payloads(state))
    row = history_row(state.unix_s, columns_of(state))
    speed, soc = row[HISTORY.index("speed_m_s")], row[HISTORY.index("soc")]
    gauges = metrics({"name": "rover", **seen})
    return {
        "page": seen["charge"] and seen["drive"] and seen["pose"],
        "live": None if seen["stale"] else True,
        "json": plain.get("battery") and plain.get("slip") and plain.get("pose"),
        "mqtt charge": topics["ohmward/robot/battery/soc"] or None,
        "mqtt speed": topics["ohmward/robot/slip/speed_m_s"] or None,
        "history": None if math.isnan(speed) and math.isnan(soc) else speed,
        "metrics charge": True if "ohmward_soc_ratio" in gauges else None,
        "metrics speed": True if "ohmward_speed_metres" in gauges else None,
        "terminal": True if "charge" in line_of(state) or "speed" in line_of(state) else None,
        "service": True if "charge" in status(process) else None,
    }


def test_a_sink_that_never_ends_does_not_hold_the_process(battery, monkeypatch, caplog):
    @dataclass
    class Deaf(Collector):
        async def run(self, feed):
            await asyncio.sleep(math.inf)

    monkeypatch.setattr("ohmward.onboard.process.END_S", 0.1)
    run(Process(Estimation(battery), [Script(samples(1), then=EndedError("done"))], [Deaf()]))
    assert "sink collector: states that were not delivered: 1" in caplog.messages


def charges(battery, messages):
    """Estimates of charge after messages that are put one by one, on the clock of their receipt."""
    collector = Collector()
    process = Process(Estimation(battery), [Script([])], [collector])
    for message in messages:
        process.put(message)
    (_, feed) = process.sinks[0]
    feed.end()
    asyncio.run(collector.run(feed))
    return process, [state.battery.soc for state in collector.states if state.battery]


def test_a_suspended_machine_leaves_a_gap(battery):
    """The monotonic clock stands still meanwhile, and so do the times of the messages."""
    clock, hours = FakeClock(100.0), 8.0
    process = Process(Estimation(battery), [Script([])], [], clock)
    awake, asleep = samples(1000)[:500], samples(1000)[500:]
    for message in awake:
        process.put(message)
    clock.suspended = 3600.0 * hours
    before = process.state.battery
    process.put(asleep[0])
    gap = Estimation(battery)
    for message in awake:
        gap.put(message.received_s, message.values)
    expected = gap.put(asleep[0].received_s + 3600.0 * hours, asleep[0].values)[0].battery
    found = process.estimation.state.battery
    assert found and before and expected
    assert found.flags == expected.flags != before.flags
    assert found.soc_std == pytest.approx(expected.soc_std, rel=1e-9)


@pytest.mark.parametrize("leap_s", [3600.0, -3600.0])
def test_a_clock_that_is_set_by_an_hour_counts_no_charge(battery, leap_s):
    """The source's clock leaps in the middle; the charge is that of the time that has really passed."""
    whole = samples(2000)
    set_back = [m._replace(stamp_s=m.stamp_s + (leap_s if k >= 1000 else 0.0)) for k, m in enumerate(whole)]
    _, expected = charges(battery, whole)
    process, found = charges(battery, set_back)
    assert found == pytest.approx(expected, abs=1e-5)
    told = {d.name: d for d in process.watch.look(whole[1000].received_s + 10.0)}
    assert "was set" in told["clock of script"].message


def test_nothing_that_a_source_can_say_ends_the_process(battery):
    """Times and values of every kind; the charge stays one."""
    odd = [math.nan, math.inf, -math.inf, 0.0, -1.0, 1e308, -1e308, 5e-324]
    messages = [
        Message(t, 100.0 + k, "script", {"battery_current_A": v, "battery_voltage_V": w, "cell_voltage_V.9": v})
        for k, (t, v, w) in enumerate((t, v, w) for t in odd for v in odd for w in odd)
    ]
    process, found = charges(battery, [*samples(10), *messages, *samples(10)])
    assert all(0.0 <= soc <= 1.1 for soc in found)
    assert "estimation" not in process.diagnostics


@pytest.mark.parametrize("rate", [0.5, 1.0, 20.0])
def test_a_replay_at_any_rate_is_neither_silent_nor_in_another_time(battery, rate):
    """The clock of a source that is not live counts for the watch; the newest state is of now, or ahead."""
    clock, source, sink = FakeClock(100.0), Script([], live=False), Collector()
    process = Process(Estimation(battery), [source], [sink], clock)
    for k, message in enumerate(samples(50)):
        clock.monotonic = 100.0 + 0.1 * k / rate
        process.put(message)
        assert [d for d in process.watch.look(process.now_s()) if d.level != Level.OK] == []
    assert process.now_s() == pytest.approx(message.received_s)
    (_, feed) = process.sinks[0]
    feed.end()
    asyncio.run(sink.run(feed))
    ahead_s = max(message.received_s - clock.monotonic, 0.0)
    assert sink.states[-1].unix_s == pytest.approx(clock.unix + ahead_s)


def test_sources_are_waited_for_from_when_they_run(battery):
    """What is compiled before takes its time."""
    clock = FakeClock(100.0)
    process = Process(Estimation(battery), [Script([], then=EndedError("done"))], [Collector()], clock)
    clock.monotonic = 200.0
    run(process)
    assert process.watch.began_s == 200.0


def test_a_process_that_was_held_up_takes_in_what_came_before_it_calls_sensors_silent(caplog):
    @dataclass
    class Live(Script):
        async def run(self, put):
            for k in itertools.count():
                now_s = time.monotonic()
                put(Message(now_s, now_s, self.name, {"battery_current_A": -1.0 - 0.01 * (k % 7)}))
                if k == 20:
                    time.sleep(1.5)  # nothing of the process runs
                await asyncio.sleep(0.02)

    run(Process(Estimation(), [Live([])], [Collector()]), seconds=2.4)
    assert [r.message for r in caplog.records if "silent" in r.message] == []


@pytest.mark.parametrize("snapshot_s", [0.05, 5.0], ids=["first snapshot", "snapshot at the end"])
def test_a_full_disk_is_named_and_estimates_go_on_and_end(battery, tmp_path, monkeypatch, snapshot_s):
    def full(*_):
        raise OhmwardError("snapshot.json: cannot be written (No space left on device); free space")

    monkeypatch.setattr("ohmward.onboard.state_folder.write_snapshot", full)
    monkeypatch.setattr("ohmward.onboard.state_folder.SNAPSHOT_S", snapshot_s)
    sink, folder = Collector(), StateFolder(tmp_path)
    process = Process(Estimation(battery), [Script(samples(50))], [sink])
    process.companions.append(("snapshots", folder.writer(process.estimation, process.now_s)))
    run(process, seconds=0.4)
    folder.close()
    assert "No space left" in process.diagnostics["snapshots"].message
    assert len(sink.states) == 50


def test_a_source_that_fails_again_and_again_is_one_line_in_the_log(battery, caplog):
    broken = Script([], "broken", OhmwardError("no such port"))
    with caplog.at_level("INFO"):
        run(Process(Estimation(battery), [broken], [Collector()]), until=lambda: broken.runs == 3)
    assert [r.message for r in caplog.records if "broken" in r.message] == ["source broken: no such port"]


def test_a_fault_whose_figures_change_is_logged_once_until_it_has_recovered(battery, caplog, monkeypatch):
    monkeypatch.setattr("ohmward.onboard.process.RECOVERED_S", 0.0)
    process = Process(Estimation(battery), [], [])

    async def reported():
        for k in range(5):
            process.report(Diagnostic("current", Level.WARN, f"{4900 + k} A now and then"))
            process.report(Diagnostic("current", Level.ERROR, f"{5200.5 + k:g} A, which cannot be"))
        process.report(Diagnostic("current", Level.OK, "reports"))
        await asyncio.sleep(0.01)
        process.report(Diagnostic("current", Level.WARN, "4900 A now and then"))

    with caplog.at_level("INFO"):
        asyncio.run(reported())
    assert [r.message for r in caplog.records] == [
        "current: 4900 A now and then",
        "current: 5200.5 A, which cannot be",
        "current: reports",
        "current: 4900 A now and then",
    ]


def test_late_messages_are_one_condition_with_the_delay_that_they_need(battery):
    """Wheels that come 0.7 s later than a gyro."""
    now_s = time.monotonic() - 4.0
    messages = [Message(math.nan, now_s + 0.05 * k, "imu", {"yaw_rate_rad_s": 1e-3 * k}) for k in range(80)]
    late = [Message(math.nan, now_s + 3.25, "wheels", moving(WHEELS, k)) for k in range(3)]
    process = Process(Estimation(battery, load_robot("rlma")), [Script(messages + late)], [Collector()])
    run(process, until=lambda: "order of messages" in process.diagnostics)
    found = process.diagnostics["order of messages"]
    assert found.level == Level.WARN and "delay_s = 0.8 would do" in found.message
    assert found.values["left_out"] == 3.0


def test_a_process_without_source_or_sink_says_so(battery, caplog):
    run(Process(Estimation(battery), [], []))
    assert [r.message.partition(":")[0] for r in caplog.records] == ["no source", "no sink"]


def test_whoever_asks_twice_to_stop_waits_for_no_sink(battery):
    class Absent(Collector):
        async def run(self, feed):
            raise OhmwardError("nobody is there")

    process = Process(Estimation(battery), [Script(samples(3))], [Absent()])

    async def main():
        loop = asyncio.get_running_loop()
        loop.call_later(0.1, process.stop)
        loop.call_later(0.2, process.stop)
        began_s = loop.time()
        await process.run()
        return loop.time() - began_s

    assert asyncio.run(main()) < 0.5 * END_S


def test_sensors_that_end_with_the_process_are_not_called_silent(battery, caplog, monkeypatch):
    class Absent(Collector):
        async def run(self, feed):
            raise OhmwardError("nobody is there")

    monkeypatch.setattr("ohmward.onboard.process.END_S", 1.6)
    now_s = time.monotonic()
    live = [message._replace(received_s=now_s + 0.1 * k - 2.0) for k, message in enumerate(samples(20))]
    run(Process(Estimation(battery), [Script(live)], [Absent()]), seconds=0.05)
    assert [r.message for r in caplog.records if "silent" in r.message] == []


def test_connections_that_cannot_be_taken_are_few_lines_in_the_log(battery, caplog):
    """The loop of asyncio tells of each, a hundred at a time, as long as there are no file handles."""

    @dataclass
    class Exhausted(Script):
        async def run(self, put):
            error = OSError(errno.EMFILE, "Too many open files")
            for _ in range(10_000):
                asyncio.get_running_loop().call_exception_handler({"message": "accept", "exception": error})
            raise EndedError("done")

    run(Process(Estimation(battery), [Exhausted([])], [Collector()]))
    told = [record for record in caplog.records if "cannot be taken" in record.message]
    assert 0 < len(told) < 20
    assert len(caplog.records) == len(told)
