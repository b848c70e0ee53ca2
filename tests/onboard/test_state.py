"""State that survives: snapshots, absences, tables, files that learn, and a process that is killed under load."""

import json
import math
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ohmward import SocEstimator, SocFlag, generic_battery, load_battery, save_battery
from ohmward.errors import OhmwardError
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.resume import remember, resume
from ohmward.onboard.robot_setup import Setup
from ohmward.onboard.state_folder import (
    CONSUMPTION,
    IN_USE,
    LEARNT,
    NAME,
    PREVIOUS,
    StateFolder,
    read_snapshot,
    write_snapshot,
)
from ohmward.trace.snapshot import sealed
from ohmward.traction.robot.packaged import RLMA, load_robot
from onboard.clocks import FakeClock


@pytest.fixture(scope="module")
def battery():
    return generic_battery("nmc", 10.0, 4)


def one(states) -> Any:
    """The only state; its parts are there."""
    (state,) = states
    return state


def driven(battery, robot=None, seconds=300, at_s=1000.0):
    """Estimators after some minutes of 2 A out of a battery that began at 60 % +- 2 %."""
    estimation = Estimation(battery, robot)
    for k in range(seconds * 2):
        values = {"battery_current_A": -2.0, "battery_voltage_V": 15.3 - 2e-4 * k}
        if robot:
            values |= {f"wheel_speed_rad_s.{j}": 4.0 for j in range(4)}
        estimation.put(at_s + 0.5 * k, values)
        if k == 0 and estimation.soc:
            estimation.soc.correct_soc(0.6, 0.02)
    return estimation


def test_a_snapshot_comes_back_and_the_one_before_stays(tmp_path):
    write_snapshot(tmp_path, {"a": 1})
    write_snapshot(tmp_path, {"a": 2})
    assert read_snapshot(tmp_path)[0]["a"] == 2
    assert json.loads((tmp_path / PREVIOUS).read_text())["a"] == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([NAME, PREVIOUS])


@pytest.mark.parametrize("damage", ["", "{", '{"version": 2, "a": 3, "checksum": "0"}', "\x00" * 50, "[" * 5000])
def test_a_damaged_snapshot_is_named_and_the_one_before_is_used(tmp_path, damage):
    write_snapshot(tmp_path, {"a": 1})
    write_snapshot(tmp_path, {"a": 2})
    (tmp_path / NAME).write_text(damage)
    content, note = read_snapshot(tmp_path)
    assert content["a"] == 1
    assert NAME in note


def test_no_snapshot_is_no_fault(tmp_path):
    assert read_snapshot(tmp_path) == ({}, "")


def test_a_cut_at_any_byte_leaves_a_snapshot(tmp_path):
    write_snapshot(tmp_path, {"a": 1})
    write_snapshot(tmp_path, {"a": 2})
    whole = (tmp_path / NAME).read_bytes()
    for length in range(len(whole)):
        (tmp_path / NAME).write_bytes(whole[:length])
        assert read_snapshot(tmp_path)[0]["a"] == 1


@pytest.mark.usefixtures("in_python")
def test_a_restart_within_a_minute_goes_on_to_the_bit(battery):
    before = driven(battery, RLMA)
    content = json.loads(json.dumps(remember(before, 1300.0), allow_nan=False))
    after = Estimation(battery, RLMA)
    assert resume(after, content, 20.0, 5.0) == []
    assert before.soc and after.soc and after.range and before.range
    assert after.range.consumption.mean.tolist() == before.range.consumption.mean.tolist()
    assert after.range.state.meter == before.range.state.meter
    expected = before.soc.update(1320.0, -2.0, 15.2)
    state: Any = one(after.put(5.0, {"battery_current_A": -2.0, "battery_voltage_V": 15.2}))
    assert state.battery == expected
    assert state.time_s == 5.0


@pytest.mark.parametrize("away_s", [300.0, 3600.0, 12 * 3600.0, math.nan])
def test_a_long_absence_widens_and_keeps_what_the_voltage_does_not_contradict(battery, away_s):
    before = driven(battery)
    charge = before.state.battery
    rest_V = float(battery.thevenin.ocv.mean_V(charge.soc, 25.0))
    after = Estimation(battery)
    resume(after, remember(before, 1300.0), away_s, 5.0)
    state: Any = one(after.put(5.0, {"battery_current_A": 0.0, "battery_voltage_V": rest_V}))
    assert isinstance(state.battery.flags, SocFlag)
    assert charge.soc_std < state.battery.soc_std < 0.15
    assert state.battery.soc == pytest.approx(charge.soc, abs=2 * state.battery.soc_std)


@pytest.mark.usefixtures("in_python")
@pytest.mark.parametrize(("error_V", "learns"), [(-0.01, False), (0.01, False), (-0.01, True)])
def test_many_restarts_tell_no_more_than_none(error_V, learns):
    """Uses of 20 s on a plateau, cells that are 10 mV off the curve, and an hour switched off between.

    learns: each use has another battery file, learnt in the one before.
    """
    battery = generic_battery("lfp", 12.0, 8)
    rest_V = float(battery.thevenin.ocv.mean_V(0.6, 25.0)) + 8 * error_V
    stds = []
    for restarts in (False, True):
        rng, time_s, estimation = np.random.default_rng(1), 0.0, Estimation(battery)
        for use in range(10):
            for _ in range(20):
                time_s += 1.0
                measured = {"battery_current_A": -0.2, "battery_voltage_V": rest_V - 0.01 + rng.normal(0.0, 0.003)}
                estimation.put(time_s, measured)
            assert estimation.state.battery
            charge = estimation.state.battery
            assert abs(charge.soc - 0.6) < 1.96 * charge.soc_std
            if restarts:
                content = remember(estimation, time_s)
                time_s += 3600.0
                estimation = Estimation(generic_battery("lfp", 12.0 - 0.01 * learns * (use + 1), 8))
                assert len(resume(estimation, content, 3600.0, time_s)) == learns
        stds.append(charge.soc_std)
    assert stds[1] > 0.95 * stds[0]


def test_a_battery_that_was_charged_meanwhile_is_told_by_its_voltage(battery):
    before = driven(battery)
    after = Estimation(battery)
    resume(after, remember(before, 1300.0), 3 * 3600.0, 5.0)
    full_V = float(battery.thevenin.ocv.mean_V(0.98, 25.0))
    for k in range(10):
        state: Any = one(after.put(5.0 + k, {"battery_current_A": -0.2, "battery_voltage_V": full_V}))
    assert state.battery.soc == pytest.approx(0.98, abs=2 * state.battery.soc_std)
    assert state.battery.soc > 0.85


@pytest.mark.parametrize("soc", [0.15, 0.2, 0.95])
@pytest.mark.parametrize("away_s", [120.0, 3600.0])
def test_a_battery_that_was_changed_unannounced_is_noticed_by_its_voltage(away_s, soc):
    """The curve of a generic file is less certain than the change of the voltage along it."""
    battery = generic_battery("nmc", 20.0, 4)
    before = driven(battery)
    assert before.state.battery
    after = Estimation(battery)
    resume(after, remember(before, 1300.0), away_s, 5.0)
    voltage_V = float(battery.thevenin.ocv.mean_V(soc, 25.0))
    for k in range(10):
        state: Any = one(after.put(5.0 + k, {"battery_current_A": -0.2, "battery_voltage_V": voltage_V}))
    assert abs(state.battery.soc - soc) < 1.96 * state.battery.soc_std


@pytest.mark.parametrize("away_s", [3600.0, 3 * 3600.0])
def test_a_wrong_first_voltage_after_an_absence_changes_nothing(battery, away_s):
    """A converter starts with the computer."""
    before: Any = driven(battery)
    right_V = float(battery.thevenin.ocv.mean_V(before.state.battery.soc, 25.0))
    found = []
    for first_V in (right_V, 12.0):
        after = Estimation(battery)
        resume(after, remember(before, 1300.0), away_s, 5.0)
        for k, voltage_V in enumerate([first_V, right_V, right_V]):
            state: Any = one(after.put(5.0 + k, {"battery_current_A": -0.2, "battery_voltage_V": voltage_V}))
        found.append(state.battery.soc)
    assert found[1] == pytest.approx(found[0], abs=0.005)


def test_a_battery_changed_during_an_absence_begins_with_its_own_voltage(battery):
    before = driven(battery)
    after = Estimation(battery)
    resume(after, remember(before, 1300.0), 3 * 3600.0, 5.0)
    after.put(5.0, {"battery_changed": 1.0})
    voltage_V = float(battery.thevenin.ocv.mean_V(0.9, 25.0))
    state: Any = one(after.put(6.0, {"battery_current_A": 0.0, "battery_voltage_V": voltage_V}))
    assert state.battery.soc == pytest.approx(0.9, abs=2 * state.battery.soc_std)


def test_another_battery_file_goes_on_with_the_charge(battery):
    before = driven(battery)
    after = Estimation(generic_battery("nmc", 11.0, 4))
    (note,) = resume(after, remember(before, 1300.0), 10.0, 5.0)
    assert "another battery file or version" in note
    state: Any = one(after.put(5.0, {"battery_current_A": -2.0, "battery_voltage_V": 15.2}))
    assert state.battery.soc == pytest.approx(before.state.battery.soc, abs=0.05)


def test_the_file_of_another_robot_begins_anew(battery):
    before = driven(battery)
    after = Estimation(generic_battery("lfp", 100.0, 16))
    (note,) = resume(after, remember(before, 1300.0), 10.0, 5.0)
    assert "another battery than before" in note
    assert after.soc and after.soc.state is None


def test_cells_go_on_too(battery):
    before = Estimation(battery)
    for k in range(200):
        cells = {f"cell_voltage_V.{j}": 3.8 + 0.002 * j for j in range(4)}
        before.put(0.5 * k, {"battery_current_A": -1.0, "battery_voltage_V": 15.2} | cells)
    after = Estimation(battery)
    resume(after, json.loads(json.dumps(remember(before, 100.0))), 5.0, 0.0)
    assert after.cells and before.cells
    assert after.cells.snapshot()["cells"] == before.cells.snapshot()["cells"]


def places_in(part, place=()):
    """Ways to every value in plain data, keys and numbers of elements."""
    inside = part.items() if isinstance(part, dict) else enumerate(part) if isinstance(part, list) else ()
    for key, value in inside:
        yield (*place, key)
        yield from places_in(value, (*place, key))


def resealed(part):
    """Plain data with new checksums, as a program of another version or of malice writes it."""
    if isinstance(part, list):
        return [resealed(item) for item in part]
    if not isinstance(part, dict):
        return part
    inner = {key: resealed(value) for key, value in part.items() if key not in ("checksum", "version")}
    return sealed(inner) if "checksum" in part else inner


@pytest.fixture(scope="module")
def taken(battery):
    """A snapshot with every part, and the battery and the robot that it is of."""
    robot = load_robot("rlma")
    before = Estimation(battery, robot)
    for k in range(40):
        pack = {"battery_current_A": -1.0, "battery_voltage_V": 15.2 - 1e-4 * k}
        cells = {f"cell_voltage_V.{j}": 3.8 + 0.002 * j for j in range(4)}
        before.put(0.5 * k, pack | cells | {f"wheel_speed_rad_s.{j}": 4.0 for j in range(4)})
    clocks = {"boot": "another", "monotonic_s": 20.0, "unix_s": 0.0}
    return json.loads(json.dumps(remember(before, 20.0) | clocks)), robot


@pytest.mark.parametrize("seed", range(3))
def test_a_snapshot_of_wrong_types_never_ends_the_process_at_its_start(tmp_path, battery, taken, seed):
    """Values of every kind, or none, at random places: the process starts, takes a sample, and says what it refused."""
    content, robot = taken
    draw, places = random.Random(seed), list(places_in(content))
    wrong: list[Any] = [None, "x", [], {}, True, -0.5, 1e30, -1e308, math.inf, 10**400, "1e999"]
    for k in range(12):
        mutant = json.loads(json.dumps(content))
        # one half at the head of each part, where the layout is; the other anywhere
        *way, last = draw.choice([place for place in places if len(place) < 4 or k % 2])
        reduce(getitem, way, mutant)[last] = draw.choice(wrong)
        path = tmp_path / str(k)
        path.mkdir()
        (path / "snapshot.json").write_text(json.dumps(sealed(resealed(mutant))))
        folder, after = StateFolder(path), Estimation(battery, robot)
        folder.begin(after)
        folder.close()
        state = after.put(1e4, {"battery_current_A": -1.0, "battery_voltage_V": 15.2})[-1]
        assert state.battery and -0.2 < state.battery.soc < 1.2


@pytest.mark.parametrize(
    ("place", "value"),
    [(("charge",), []), (("charge", "soc"), "x"), (("charge", "std"), 1e308), (("battery",), None), (("time_s",), {})],
)
def test_a_snapshot_that_cannot_be_is_refused_in_one_line(battery, taken, place, value):
    mutant = json.loads(json.dumps(taken[0]))
    reduce(getitem, place[:-1], mutant)[place[-1]] = value
    after = Estimation(battery)
    (note,) = resume(after, mutant, 10.0, 5.0)
    assert note.startswith("the snapshot cannot be used") and place[0] in note
    assert after.soc and after.soc.state is None


def folder(path, clock, **options):
    return StateFolder(path, clock=clock, **options)


def test_the_time_away_is_that_of_the_monotonic_clock_within_a_boot(tmp_path, battery):
    clock = FakeClock()
    first = folder(tmp_path, clock)
    first.write(driven(battery), clock.now_s())
    first.close()
    clock.monotonic += 50.0
    clock.suspended += 7.0
    clock.unix -= 3600.0
    second = folder(tmp_path, clock)
    assert second.away_s == 57.0
    second.close()


@pytest.mark.parametrize(
    ("before_s", "is_set", "unix_s", "away_s"),
    [
        (1.8e9, True, 7200.0, 7200.0),
        (1.8e9, False, 30.0, math.nan),
        (1.8e9, True, -1.8e9, math.nan),
        (60.0, True, 1.8e9, math.nan),
    ],
    ids=["set", "goes on from its shutdown", "begins in 1970", "began in 1970"],
)
def test_the_time_away_after_another_boot_is_that_of_a_wall_clock_that_is_set(
    tmp_path, battery, monkeypatch, before_s, is_set, unix_s, away_s
):
    clock = FakeClock(unix_s=before_s)
    first = folder(tmp_path, clock)
    first.write(driven(battery), clock.now_s())
    first.close()
    monkeypatch.setattr("ohmward.onboard.state_folder.boot_id", lambda: "another")
    clock.monotonic, clock.unix, clock.set = 3.0, clock.unix + unix_s, is_set
    second = folder(tmp_path, clock)
    np.testing.assert_equal(second.away_s, away_s)
    second.close()


def test_a_folder_serves_one_process(tmp_path):
    first = folder(tmp_path, FakeClock())
    with pytest.raises(OhmwardError, match=r"another process uses the folder .*state = \.\.\."):
        folder(tmp_path, FakeClock())
    first.close()
    folder(tmp_path, FakeClock()).close()


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OhmwardError, match="choose a folder that takes files"):
        folder(tmp_path / "file", FakeClock())


def test_the_consumption_table_goes_on_across_days(tmp_path, battery):
    clock = FakeClock()
    first = folder(tmp_path, clock)
    assert first.consumption() == (None, 0.0)
    estimation = Estimation(battery, RLMA)
    for k in range(1200):
        speed = 0.0 if 600 <= k < 900 else 4.0
        wheels = {f"wheel_speed_rad_s.{j}": speed for j in range(4)}
        estimation.put(0.2 * k, {"battery_current_A": -1.0, "battery_voltage_V": 15.2} | wheels)
    first.write(estimation, clock.now_s())
    first.close()
    assert (tmp_path / CONSUMPTION).exists()
    clock.unix += 2 * 86400.0
    second = folder(tmp_path, clock)
    table, days = second.consumption()
    assert days == pytest.approx(2.0)
    assert table and estimation.range
    assert table.mean == pytest.approx(estimation.range.consumption.mean)
    second.close()


def test_a_drive_that_ended_at_the_cutoff_is_in_the_consumption_table_of_the_next_day(tmp_path, battery):
    setup = Setup(battery="battery.toml", robot="rlma", cutoff_V=12.8)
    first = folder(tmp_path, FakeClock())
    estimation = Estimation(battery, RLMA, cutoff_V=setup.cutoff_V)
    for k in range(1400):
        values = {"battery_current_A": -10.0, "battery_voltage_V": 16.4 - 0.0026 * k}
        estimation.put(2.0 * k, values | {f"wheel_speed_rad_s.{j}": 4.0 for j in range(4)})
    first.write(estimation, 2800.0)
    first.close()
    second = folder(tmp_path, FakeClock())
    table, _ = second.consumption()
    second.close()
    assert table and table.end
    assert table.end.voltage_V == pytest.approx(12.8, abs=0.05)
    assert table.end.given_Ah == pytest.approx(10.0 * table.end.hours)


def test_a_cutoff_stays_where_a_drive_goes_on_after_a_restart(battery):
    before = Estimation(battery, RLMA, cutoff_V=12.8)
    after = Estimation(battery, RLMA, cutoff_V=12.8)
    for away_s in (20.0, 12 * 3600.0):
        resume(after, remember(before, 1300.0), away_s, 5.0)
        assert after.range and after.range.settings.cutoff_V == 12.8


@pytest.mark.usefixtures("in_python")
def test_a_file_that_learns_is_in_use_from_the_next_day_on(tmp_path, battery):
    given = tmp_path / "given.toml"
    save_battery(battery, given)
    clock = FakeClock()
    state = tmp_path / "state"
    for away_s, in_use in ((0.0, False), (600.0, False), (10 * 3600.0, True)):
        clock.monotonic += away_s
        clock.unix += away_s
        now = folder(state, clock, learn=True)
        used = now.battery(str(given))
        assert (state / IN_USE).exists() == in_use
        assert (used.knowledge is not None and bool(used.knowledge.logs)) == in_use
        estimation = driven(used, at_s=clock.now_s())
        now.write(estimation, clock.now_s())
        assert (state / LEARNT).exists()
        now.close()
    later = time.time() + 10.0
    os.utime(given, (later, later))  # by a clock that was ahead
    again = folder(state, clock, learn=True)
    assert again.battery(str(given)).knowledge == used.knowledge
    again.close()
    save_battery(generic_battery("nmc", 11.0, 4), given)
    os.utime(given, (0.0, 0.0))
    changed = folder(state, clock, learn=True)
    assert changed.battery(str(given)) == load_battery(given)
    assert "given.toml has changed" in changed.notes[-1]
    assert not (state / LEARNT).exists()
    changed.close()


@pytest.mark.parametrize("board", ["other", "same"])
def test_the_state_on_a_copied_disk_is_named_and_not_believed(tmp_path, battery, monkeypatch, board):
    """A system that was installed again on the same board has the same battery."""
    save_battery(battery, given := tmp_path / "given.toml")
    monkeypatch.setattr("ohmward.onboard.state_folder.computer", lambda: {"board": "same", "system": "a"})
    first = folder(tmp_path / "state", FakeClock(), learn=True)
    first.write(driven(first.battery(str(given))), 1300.0)
    first.close()
    monkeypatch.setattr("ohmward.onboard.state_folder.computer", lambda: {"board": board, "system": "b"})
    second, after = folder(tmp_path / "state", FakeClock(), learn=True), Estimation(battery)
    second.begin(after)
    second.close()
    assert (tmp_path / "state" / LEARNT).exists() == bool(second.before) == (board == "same")
    assert any("of another computer" in note for note in second.notes) == (board == "other")
    assert after.soc and (after.soc.state is None) == (board == "other")


def test_a_disk_that_is_full_by_now_keeps_no_known_battery_from_starting(tmp_path, battery, monkeypatch):
    save_battery(battery, given := tmp_path / "given.toml")
    first = folder(tmp_path / "state", FakeClock(), learn=True)
    first.battery(str(given))
    first.close()

    def full(*_):
        raise OhmwardError("no space left on device")

    monkeypatch.setattr("ohmward.onboard.state_folder.write_text", full)
    assert folder(tmp_path / "state", FakeClock(), learn=True).battery(str(given)) == load_battery(given)


def test_what_was_learnt_goes_with_the_battery_that_is_taken_out(tmp_path, battery):
    state, given = tmp_path / "state", tmp_path / "given.toml"
    save_battery(battery, given)
    now = folder(state, FakeClock(), learn=True)
    label = now.battery(str(given))
    estimation = driven(label)
    now.write(estimation, 1300.0)
    shutil.copy(state / LEARNT, state / IN_USE)
    estimation.put(1301.0, {"battery_changed": 1.0})
    now.write(estimation, 1301.0)
    assert not (state / LEARNT).exists() and not (state / IN_USE).exists()
    now.close()


PROCESS = """
import asyncio, sys
from ohmward.onboard.assembly import assemble
from ohmward.onboard.robot_setup import SETUP_FILE
import ohmward.onboard.state_folder as state_folder
state_folder.SNAPSHOT_S = 0.002
process = assemble(SETUP_FILE.load(sys.argv[1]))
asyncio.run(process.run())
"""


def make_setup(tmp_path, battery):
    save_battery(battery, tmp_path / "battery.toml")
    rows = ["time_s,current_A,voltage_V"]
    rows += [f"{0.01 * k:.2f},{-2.0 - math.sin(0.01 * k):.4f},{15.3 - 2e-5 * k:.4f}" for k in range(40_000)]
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    text = f"""
format = "ohmward-setup/1"
battery = "{tmp_path}/battery.toml"
state = "{tmp_path}/state"
voltage_gain_std = 0.0
[[source]]
kind = "replay"
path = "{tmp_path}/log.csv"
current_sign = "charge"
rate = 50.0
[[sink]]
kind = "json-lines"
path = "{tmp_path}/states.jsonl"
interval_s = 1.0
"""
    (tmp_path / "robot.toml").write_text(text)
    return tmp_path / "robot.toml"


def wait_for(path: Path, process):
    """Wait until the process has written a snapshot of its own."""
    written = path.stat().st_mtime_ns if path.exists() else 0
    for _ in range(3000):
        assert process.poll() is None
        if path.exists() and path.stat().st_mtime_ns != written:
            return
        time.sleep(0.01)
    pytest.fail("no snapshot was written")


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="SIGKILL")
def test_the_charge_goes_on_after_every_kill(tmp_path, battery):
    """Kill the process under load at random moments; after each the snapshot loads and the charge goes on."""
    setup, draw = make_setup(tmp_path, battery), random.Random(2)
    before = None
    for _ in range(int(os.environ.get("OHMWARD_KILLS", "6"))):
        with subprocess.Popen([sys.executable, "-c", PROCESS, str(setup)]) as process:
            try:
                wait_for(tmp_path / "state" / NAME, process)
                time.sleep(draw.uniform(0.0, 0.3))
            finally:
                process.send_signal(signal.SIGKILL)
        content, note = read_snapshot(tmp_path / "state")
        assert content, note
        assert note == ""
        restored = SocEstimator.restore(load_battery(tmp_path / "battery.toml"), content["soc"])
        assert restored.state is not None
        charge = content["charge"]
        if before is not None:
            moved = abs(charge["soc"] - before["soc"])
            assert moved <= 0.02 + 2.0 * before["std"]
        before = charge
