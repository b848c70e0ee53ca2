"""The store: every row once, whatever happens to power, disk and server."""

import asyncio
import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from ohmward.atomic import held_folder
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.sinks.store import StoreSink
from ohmward.onboard.store.rows import ConditionRow, Row, RowMaker
from ohmward.onboard.store.store import Store
from onboard.page_server import drive

DAY_NS = 86_400 * 10**9
START_NS = 20_000 * DAY_NS


def rows(count, kind="battery", start_ns=START_NS, step_ns=10**9, **more):
    return [Row(kind, start_ns + k * step_ns, {"soc": k / count, **more}) for k in range(count)]


def filled_feed() -> Feed:
    feed = Feed()
    for state in drive():
        feed.put(state)
    feed.end()
    return feed


def test_each_estimate_becomes_one_row():
    maker = RowMaker()
    found = [row for state in drive() for row in maker.rows(state)]
    battery = [row for row in found if row.kind == "battery"]
    assert len(battery) == len({state.battery_time_s for state in drive()}) == 40
    assert battery[0].values["battery_voltage_V"] == 13.2
    last = found[-1]
    assert last.kind == "drive" and "slip_ratio.front_left" in last.values and "x_m" in last.values
    assert [c.name for c in maker.conditions(drive()[0])] == ["source can0", "battery_voltage_V"]
    assert list(maker.conditions(drive()[1])) == []


def test_times_go_on_while_the_wall_clock_is_steered():
    maker, state = RowMaker(), drive()[-1]
    first, second = (next(iter(maker.rows(state._replace(drive_time_s=t)))) for t in (state.time_s, state.time_s + 0.1))
    assert second.unix_ns != first.unix_ns


def test_what_is_stored_is_read(tmp_path):
    store = Store(tmp_path)
    store.add(rows(10) + rows(5, "drive"))
    store.add(rows(3, start_ns=START_NS + 10**11, resistance_ratio=1.5))
    read = Store(tmp_path, read_only=True).read("battery")
    assert len(read["unix_ns"]) == 13
    assert read["soc"][:10].tolist() == [k / 10 for k in range(10)]
    assert np.isnan(read["resistance_ratio"][:10]).all() and (read["resistance_ratio"][10:] == 1.5).all()
    assert store.read("battery", ["soc"], since_s=START_NS / 1e9 + 100)["unix_ns"].size == 3
    with pytest.raises(InputError, match="there are rows of battery and drive"):
        store.read("weather")


def test_the_store_is_thinned_to_the_first_row_of_each_step(tmp_path, monkeypatch):
    monkeypatch.setattr("ohmward.onboard.store.store.ARCHIVE_ROWS", 70)
    store = Store(tmp_path)
    store.add(rows(200))
    store.add(rows(100, start_ns=START_NS + DAY_NS))
    whole = store.read("battery", ["soc"])
    store.archive_days((START_NS + DAY_NS) / 1e9)
    store.add(rows(5, start_ns=START_NS + DAY_NS + 10**12, **{"late": 1.0}))
    found = store.thinned("battery", ["soc", "late"], START_NS + 5, START_NS + DAY_NS + 10**11 - 1, 7 * 10**9)
    later = whole["unix_ns"] >= START_NS + 5
    first = np.unique(whole["unix_ns"][later] // (7 * 10**9), return_index=True)[1]
    assert np.array_equal(found["unix_ns"], whole["unix_ns"][later][first])
    assert np.array_equal(found["soc"], whole["soc"][later][first]) and np.isnan(found["late"]).all()
    next((tmp_path / "archive").iterdir()).write_bytes(b"damaged")
    assert 0 < len(Store(tmp_path).thinned("battery", ["soc"], 0, 2**62, 8 * 10**9)["soc"]) < 300 / 8


def test_a_column_may_have_any_name(tmp_path):
    store = Store(tmp_path)
    store.add([Row("battery", START_NS, {'a"; DROP TABLE battery; --': 1.0})])
    assert store.read("battery")['a"; DROP TABLE battery; --'].tolist() == [1.0]


def test_days_that_are_over_go_to_parquet_and_are_read_as_before(tmp_path):
    store = Store(tmp_path)
    for day in range(4):
        store.add(rows(100, start_ns=START_NS + day * DAY_NS) + rows(50, "drive", START_NS + day * DAY_NS))
    before = {kind: store.read(kind) for kind in ("battery", "drive")}
    done = store.archive_days((START_NS + 3 * DAY_NS) / 1e9)
    assert [entry.rows for entry in done] == [100, 100, 100, 50, 50, 50]
    assert store.archive_days((START_NS + 3 * DAY_NS) / 1e9) == []
    for kind, columns in before.items():
        after = store.read(kind)
        assert after.keys() == columns.keys()
        assert all(np.array_equal(after[name], columns[name]) for name in columns)
    assert store.span_ns("battery") == (400, START_NS, START_NS + 3 * DAY_NS + 99 * 10**9)
    part = store.read("battery", ["soc"], (START_NS + DAY_NS) / 1e9, (START_NS + DAY_NS) / 1e9 + 9)
    assert part["soc"].size == 10


def test_a_day_goes_to_the_archive_in_pieces_that_fit_into_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("ohmward.onboard.store.store.ARCHIVE_ROWS", 30)
    store = Store(tmp_path)
    store.add(rows(100))
    before = store.read("battery")
    assert [entry.rows for entry in store.archive_days((START_NS + DAY_NS) / 1e9)] == [30, 30, 30, 10]
    assert all(np.array_equal(column, before[name]) for name, column in store.read("battery").items())


def test_the_database_is_bounded_whatever_the_day(tmp_path, monkeypatch):
    monkeypatch.setattr("ohmward.onboard.store.store.ARCHIVE_ROWS", 1000)
    store = Store(tmp_path)
    store.add(rows(5000) + rows(5000, "drive"))
    before = store._database_bytes()
    assert store.archive_excess(before) == []
    done = store.archive_excess(before // 2)
    assert done and max(entry.first_ns for entry in done) < START_NS + 4000 * 10**9, "the oldest of each kind go first"
    assert store._database_bytes() <= before // 2
    assert store.span_ns("battery")[0] == store.span_ns("drive")[0] == 5000


def test_conditions_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr("ohmward.onboard.store.store.MOST_CONDITIONS", 50)
    store = Store(tmp_path)
    store.add([], [ConditionRow(START_NS + k, "wheel", "WARN", "loose") for k in range(80)])
    store.prune(10**9)
    assert [condition.unix_ns - START_NS for condition in store.conditions()] == list(range(30, 80))


def test_the_archive_outlives_its_database(tmp_path):
    store = Store(tmp_path)
    store.add(rows(10))
    store.archive_days((START_NS + DAY_NS) / 1e9)
    store.close()
    (tmp_path / "store.sqlite").unlink()
    again = Store(tmp_path)
    again.add(rows(10, start_ns=START_NS + DAY_NS))
    names = [entry.name[-25:] for entry in again.archive_days((START_NS + 2 * DAY_NS) / 1e9)]
    assert names == ["00000011-00000020.parquet"]
    again.close()
    assert len(Store(tmp_path).read("battery")["soc"]) == 20


def test_an_archive_that_was_begun_before_a_loss_of_power_is_removed(tmp_path):
    store = Store(tmp_path)
    store.add(rows(10))
    store.close()
    (tmp_path / "archive" / "battery-2024-10-04-00000001-00000010.parquet").write_bytes(b"half")
    assert len(Store(tmp_path).read("battery")["soc"]) == 10
    assert list((tmp_path / "archive").iterdir()) == []


def test_the_oldest_files_go_when_the_store_grows_too_large(tmp_path):
    store = Store(tmp_path)
    for day in range(3):
        store.add(rows(1000, start_ns=START_NS + day * DAY_NS))
    names = [entry.name for entry in store.archive_days((START_NS + 3 * DAY_NS) / 1e9)]
    assert store.prune(10**9) == []
    assert store.prune(store.size_bytes() - 1) == names[:1]
    assert len(store.read("battery")["soc"]) == 2000


def test_a_full_disk_loses_nothing_and_is_named(tmp_path):
    store = Store(tmp_path)
    store.add(rows(10))
    (pages,) = store._database.execute("PRAGMA page_count").fetchone()
    store._database.execute(f"PRAGMA max_page_count = {pages}")
    with pytest.raises(OhmwardError, match="is the disk full"):
        store.add(rows(20_000, start_ns=START_NS + 10**12, **{f"x{k}": 1.0 for k in range(10)}))
    assert len(store.read("battery")["soc"]) == 10
    store._database.execute("PRAGMA max_page_count = 100000")
    store.add(rows(20_000, start_ns=START_NS + 10**12, **{f"x{k}": 1.0 for k in range(10)}))
    assert len(store.read("battery")["soc"]) == 20_010


def test_states_that_a_full_disk_refuses_go_back_to_the_feed(tmp_path, monkeypatch):
    def full(*_):
        raise OhmwardError("is the disk full?")

    monkeypatch.setattr(Store, "add", full)
    feed = filled_feed()
    with pytest.raises(OhmwardError):
        asyncio.run(StoreSink(str(tmp_path)).run(feed))
    monkeypatch.undo()
    asyncio.run(StoreSink(str(tmp_path)).run(feed))
    assert len(Store(tmp_path).read("battery")["soc"]) == 40
    assert feed.lost == 0


def test_a_disk_that_was_full_for_a_while_leaves_every_row_once(tmp_path, monkeypatch):
    monkeypatch.setattr("ohmward.onboard.store.delivery.FIRST_WAIT_S", 0.01)
    add = Store.add
    refused: list[tuple] = []

    def full_twice(store, *rows):
        if len(refused) < 2:
            refused.append(rows)
            raise OhmwardError("is the disk full?")
        add(store, *rows)

    monkeypatch.setattr(Store, "add", full_twice)

    async def run():
        feed, said = Feed(), []
        running = asyncio.create_task(StoreSink(str(tmp_path), commit_s=0.0).run(feed))
        for state in drive():
            feed.put(state)
            said.append(feed.trouble)
            await asyncio.sleep(0.002)
        feed.end()
        await running
        return said, feed.trouble

    said, after = asyncio.run(run())
    assert "is the disk full?" in said and after == ""
    stored = Store(tmp_path, read_only=True)
    assert {kind: len(stored.read(kind)["unix_ns"]) for kind in ("battery", "drive")} == {"battery": 40, "drive": 40}


def test_an_archive_that_cannot_be_written_is_named_and_rows_go_on(tmp_path, monkeypatch):
    def full(*_):
        raise OhmwardError("archive cannot be written")

    monkeypatch.setattr("ohmward.onboard.store.store.write_table", full)
    first = Store(tmp_path)
    first.add(rows(10))
    first.close()
    feed = filled_feed()
    asyncio.run(StoreSink(str(tmp_path)).run(feed))
    assert "rows are stored, older ones cannot be archived: archive cannot be written" in feed.trouble
    assert len(Store(tmp_path).read("battery")["soc"]) == 50


def test_old_files_go_before_a_full_disk_is_asked_for_more(tmp_path, monkeypatch):
    store = Store(tmp_path)
    for day in range(3):
        store.add(rows(1000, start_ns=START_NS + day * DAY_NS))
    store.archive_days((START_NS + 2 * DAY_NS) / 1e9)

    def full(*_):
        raise OhmwardError("archive cannot be written")

    monkeypatch.setattr("ohmward.onboard.store.store.write_table", full)
    with pytest.raises(OhmwardError, match="archive cannot"):
        StoreSink(str(tmp_path), keep_days=0.5, most_MB=1e-6).clean(store, (START_NS + 5 * DAY_NS) / 1e9)
    assert store.archived() == []


def test_the_sink_stores_all_and_says_what_changed(tmp_path):
    asyncio.run(StoreSink(str(tmp_path)).run(filled_feed()))
    store = Store(tmp_path, read_only=True)
    assert len(store.read("battery")["soc"]) == 40
    assert [condition.level for condition in store.conditions()] == ["OK", "WARN"]


def test_a_store_is_written_by_one_process(tmp_path):
    fix = r"another process uses the folder .*: folder = \.\.\."
    with held_folder(tmp_path, "folder"), pytest.raises(OhmwardError, match=fix):
        asyncio.run(StoreSink(str(tmp_path)).run(filled_feed()))


def test_a_damaged_file_of_the_archive_is_left_out_and_named(tmp_path, caplog):
    store = Store(tmp_path)
    for day in range(3):
        store.add(rows(10, start_ns=START_NS + day * DAY_NS))
    store.archive_days((START_NS + 2 * DAY_NS) / 1e9)
    first, second = sorted((tmp_path / "archive").iterdir())
    first.write_bytes(b"damaged")
    assert len(store.read("battery")["soc"]) == 20 and first.name in caplog.text
    second.unlink()
    assert len(store.read("battery")["soc"]) == 10 and second.name in caplog.text


def test_a_damaged_database_is_named_with_the_way_out(tmp_path):
    store = Store(tmp_path)
    store.add(rows(2000))
    store.archive_days((START_NS + DAY_NS) / 1e9)
    store.add(rows(2000, start_ns=START_NS + DAY_NS))
    store.close()
    path = tmp_path / "store.sqlite"
    whole = path.read_bytes()
    path.write_bytes(whole[:8192] + b"\xff" * (len(whole) - 8192))
    store = Store(tmp_path, read_only=True)
    with pytest.raises(OhmwardError, match="it is damaged or no store: move it away"), store.reading():
        store.read("battery")
    path.rename(tmp_path / "damaged.sqlite")
    assert len(Store(tmp_path).read("battery")["soc"]) == 2000


def test_a_store_on_a_read_only_disk_is_read_without_a_trace(tmp_path, monkeypatch):
    store = Store(tmp_path)
    store.add(rows(10))
    store.close()
    monkeypatch.setattr(os, "access", lambda *_: False)
    reader = Store(tmp_path, read_only=True)
    assert len(reader.read("battery")["soc"]) == 10
    assert {path.name for path in tmp_path.iterdir()} == {"archive", "store.sqlite"}


@pytest.mark.parametrize("what", ["nothing", "text", "newer", "empty"])
def test_a_folder_that_holds_no_store_is_named(tmp_path, what):
    if what == "nothing":
        with pytest.raises(InputError, match="there is no store; give the folder"):
            Store(tmp_path, read_only=True)
        return
    if what == "empty":
        (tmp_path / "store.sqlite").touch()
        with pytest.raises(OhmwardError, match="the database is empty"):
            Store(tmp_path, read_only=True)
        return
    if what == "text":
        (tmp_path / "store.sqlite").write_text("no database, but long enough to be taken for one" * 100)
    else:
        Store(tmp_path)._database.execute("PRAGMA user_version = 99")
    with pytest.raises(OhmwardError, match=r"cannot be opened|version 99"):
        Store(tmp_path)


#: Forks a writer for each first row on its standard input, and says "end" when that is gone.
FORKS_WRITERS = """
import os, sys
from pathlib import Path
from ohmward.onboard.store.rows import Row
from ohmward.onboard.store.store import Store

def write(first, day=86_400 * 10**9):
    store = Store(Path(sys.argv[1]))
    for k in range(first, first + 10**6, 20):
        store.add([Row("battery", 20_000 * day + n * 10**12, {"n": float(n)}) for n in range(k, k + 20)])
        os.write(1, f"{k + 20}\\n".encode())  # the line whole or not at all
        if k % 100 == 0:
            store.archive_days((20_000 * day + k * 10**12) / 1e9)

for line in sys.stdin:
    if not (writer := os.fork()):
        print(os.getpid(), flush=True)
        write(int(line))
    os.waitpid(writer, 0)
    print("end", flush=True)
"""


@pytest.mark.slow
def test_no_row_is_lost_or_stored_twice_when_the_process_is_killed(tmp_path):
    """Kill a process that writes and archives, again and again."""
    kills, rng, acknowledged = int(os.environ.get("OHMWARD_KILLS", "25")), random.Random(2), 0
    command = [sys.executable, "-c", FORKS_WRITERS, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1) as forks:
        assert forks.stdin is not None and forks.stdout is not None
        for _ in range(kills):
            forks.stdin.write(f"{acknowledged}\n")
            writer, _ = int(forks.stdout.readline()), forks.stdout.readline()
            time.sleep(rng.uniform(0.0, 0.15))
            os.kill(writer, signal.SIGKILL)
            said = list(iter(forks.stdout.readline, "end\n"))
            stored = Store(tmp_path).read("battery", ["n"])["n"]
            least = int(said[-1]) if said else acknowledged + 20
            assert np.array_equal(stored, np.arange(len(stored))), "a row is missing or stands twice"
            assert len(stored) >= least, "an acknowledged row was lost"
            acknowledged = len(stored)
    assert acknowledged > kills * 20
