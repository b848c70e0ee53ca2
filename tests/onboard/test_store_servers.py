"""Rows in real servers: every one once, though the server goes away and the process is killed in between."""

import asyncio
import http.server
import json
import subprocess
import sys
import threading
import time
import urllib.parse
import urllib.request
from collections.abc import Sequence
from functools import partial
from typing import ClassVar

import pytest

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.sinks.server import InfluxSink, PostgresqlSink, lines, write_lines, write_rows
from ohmward.onboard.store.delivery import Spool, deliver, done_in_thread, send_batch
from ohmward.onboard.store.rows import Row
from onboard.page_server import drive
from onboard.servers import free_port, influxdb, postgresql, victoria_metrics

NOW_NS = time.time_ns() // 10**9 * 10**9


def rows(count, first=0):
    return [
        Row("battery", NOW_NS + k * 10**9, {"soc": k / 1000, "x.front_left": 1.5}) for k in range(first, first + count)
    ]


def fed(states=None) -> Feed:
    feed = Feed()
    for state in states or drive():
        feed.put(state._replace(unix_s=NOW_NS / 1e9 + state.time_s))
    return feed


def test_lines_hold_whatever_a_name_holds():
    row = Row("drive", 17, {"slip ratio,front=left": 0.25})
    assert lines([row], "my rover=1") == "drive,robot=my\\ rover\\=1 slip\\ ratio\\,front\\=left=0.25 17\n"
    assert lines([Row("drive", 17, {})], "rover") == ""


def test_a_spool_keeps_its_rows_over_a_restart_and_gives_them_in_order(tmp_path):
    spool = Spool(tmp_path / "spool", 1000)
    spool.put(rows(5))
    number, first = spool.oldest(3)
    spool.confirm(number)
    spool.close()
    again = Spool(tmp_path / "spool", 1000)
    assert first == rows(3) and again.waiting == 2
    assert again.oldest(10)[1] == rows(2, 3)


CLOSED_WHILE_READ = """
import sqlite3, sys, threading
from pathlib import Path
from ohmward.onboard.store.rows import Row
from ohmward.onboard.store.delivery import Spool

def read(spool):
    try:
        while True:
            spool.oldest(500)
    except sqlite3.ProgrammingError:  # it is closed
        pass

for k in range(100):
    spool = Spool(Path(sys.argv[1]) / f"{k}", 1000)
    spool.put([Row("drive", n, {"speed_m_s": 0.1 * n}) for n in range(500)])
    reader = threading.Thread(target=read, args=[spool])
    reader.start()
    spool.close()
    reader.join()
"""


def test_a_spool_that_is_closed_while_a_thread_reads_does_not_take_the_process_with_it(tmp_path):
    done = subprocess.run([sys.executable, "-c", CLOSED_WHILE_READ, tmp_path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_who_is_cancelled_while_a_thread_writes_goes_on_when_it_is_done():
    entered, release, events = threading.Event(), threading.Event(), []

    def write():
        entered.set()
        release.wait(10.0)
        events.append("written")

    async def run():
        writing = asyncio.create_task(done_in_thread(write))
        await asyncio.to_thread(entered.wait, 10.0)
        writing.cancel()
        await asyncio.sleep(0.05)
        release.set()
        with pytest.raises(asyncio.CancelledError):
            await writing
        events.append("cancelled")

    asyncio.run(run())
    assert events == ["written", "cancelled"]


def test_a_spool_ends_and_counts_what_it_leaves_out(tmp_path):
    spool = Spool(tmp_path / "spool", 100)
    for k in range(5):
        spool.put(rows(30, 30 * k))
    assert (spool.waiting, spool.lost) == (100, 50)
    assert spool.oldest(1)[1] == rows(1, 50)


def test_a_row_that_was_sent_and_not_confirmed_is_sent_again(tmp_path):
    spool, sent = Spool(tmp_path / "spool", 100), []
    spool.put(rows(3))

    def answer_lost(batch):
        sent.append(batch)
        if len(sent) == 1:
            raise OhmwardError("no answer")

    with pytest.raises(OhmwardError):
        send_batch(spool, answer_lost)
    send_batch(spool, answer_lost)
    assert sent == [rows(3), rows(3)] and spool.waiting == 0


def test_while_the_server_is_away_rows_wait_and_the_trouble_is_named(tmp_path):
    away, taken = [True], []

    def send(batch):
        if away[0]:
            raise OhmwardError("db cannot be reached; is the server running?")
        taken.extend(batch)

    async def run():
        feed = fed()
        running = asyncio.create_task(deliver(feed, send, tmp_path / "spool"))
        while not feed.trouble:
            await asyncio.sleep(0.01)
        said, away[0] = feed.trouble, False
        while not taken:
            await asyncio.sleep(0.01)
        feed.end()
        await running
        return said, feed.trouble

    said, after = asyncio.run(run())
    assert "is the server running" in said and after == ""
    assert len({(row.kind, row.unix_ns) for row in taken}) == len(taken) == 80


def test_a_disk_that_is_full_for_a_while_loses_no_row(tmp_path, monkeypatch):
    monkeypatch.setattr("ohmward.onboard.store.delivery.FIRST_WAIT_S", 0.01)
    put = Spool.put
    refused: list[Sequence[Row]] = []
    taken: list[Row] = []

    def full_once(spool, batch):
        if not refused:
            refused.append(batch)
            raise OhmwardError("is the disk full?")
        put(spool, batch)

    monkeypatch.setattr(Spool, "put", full_once)

    async def run():
        feed = fed()
        running = asyncio.create_task(deliver(feed, taken.extend, tmp_path / "spool"))
        while not feed.trouble and not running.done():
            await asyncio.sleep(0.001)
        while not taken and not running.done():
            await asyncio.sleep(0.01)
        feed.end()
        await running
        return feed.trouble

    assert asyncio.run(run()) == ""
    assert len({(row.kind, row.unix_ns) for row in taken}) == len(taken) == 80


def test_rows_that_a_spool_leaves_out_are_counted_in_the_feed(tmp_path):
    def away(_):
        raise OhmwardError("db cannot be reached")

    feed = fed()
    feed.end()
    asyncio.run(deliver(feed, away, tmp_path / "spool", most_waiting=30))
    assert feed.lost == 50


@pytest.mark.parametrize("server", [influxdb, victoria_metrics])
def test_every_row_is_once_in_a_server_of_line_protocol(tmp_path, server):
    port = free_port()
    sink = InfluxSink(
        f"http://127.0.0.1:{port}/write?db=robots", robot="rover", spool=str(tmp_path / "spool"), interval_s=0.0
    )

    async def run():
        feed = fed()
        feed.end()
        await sink.run(feed)

    asyncio.run(run())  # the server is away: the rows wait
    assert Spool(tmp_path / "spool", 10**6).waiting == 80
    with server(tmp_path, port) as address:
        asyncio.run(run())  # the same states once more, as after a restart
        counted = in_influx(address) if server is influxdb else in_victoria(address)
    assert Spool(tmp_path / "spool", 10**6).waiting == 0
    assert counted == 40


def in_influx(address):
    query = urllib.parse.urlencode({"db": "robots", "q": "SELECT count(soc) FROM battery WHERE robot = 'rover'"})
    with urllib.request.urlopen(f"{address}/query?{query}", timeout=60) as answer:
        return json.load(answer)["results"][0]["series"][0]["values"][0][1]


def in_victoria(address):
    urllib.request.urlopen(f"{address}/internal/force_flush", timeout=60).read()
    match = urllib.parse.urlencode({"match[]": 'battery_soc{robot="rover"}'})
    with urllib.request.urlopen(f"{address}/api/v1/export?{match}", timeout=60) as answer:
        series = [json.loads(line) for line in answer]
    return sum(len(set(one["timestamps"])) for one in series)


def test_every_row_is_once_in_postgresql(tmp_path):
    port = free_port()
    with postgresql(tmp_path, port) as address:
        send = partial(write_rows, robot="rover", address=address)
        send(rows(100))
        send(rows(100, 50))
        sink = PostgresqlSink(address, robot="rover", spool=str(tmp_path / "spool"), interval_s=0.0)
        feed = fed()
        feed.end()
        asyncio.run(sink.run(feed))
        assert in_postgresql(address, "ohmward_drive") == 40
        assert in_postgresql(address, "ohmward_battery") >= 150
    with pytest.raises(OhmwardError, match="PostgreSQL takes no rows"):
        send(rows(1))
    with postgresql(tmp_path, port) as address:
        send(rows(1, 10_000))
        assert in_postgresql(address, "ohmward_battery") >= 151


def in_postgresql(address, table):
    import psycopg

    with psycopg.connect(address) as connection:
        found = connection.execute(f"SELECT count(*) FROM {table} WHERE robot = 'rover'").fetchone()
        assert found is not None
        return found[0]


def test_a_server_that_refuses_is_quoted(tmp_path):
    port = free_port()
    with influxdb(tmp_path, port) as address, pytest.raises(OhmwardError, match=r"refuses the rows \(404 .*not found"):
        write_lines(f"{address}/write?db=nothing", lines(rows(1), "rover"))


class OtherServer(http.server.BaseHTTPRequestHandler):
    """A server that is none of a database: `/login` is a page for people, everything else leads there."""

    seen: ClassVar[list[str | None]] = []

    def do_POST(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        if self.path == "/login":
            self._answer(200)
        else:
            self._answer(302)

    def do_GET(self):
        self.seen.append(self.headers["Authorization"])
        self._answer(200)

    def _answer(self, status):
        self.send_response(status)
        self.send_header("Location", "/login")
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *_):
        pass


@pytest.fixture
def other_server():
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), OtherServer)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


@pytest.mark.parametrize(("path", "status"), [("/write?db=robots", 302), ("/login", 200)])
def test_a_page_of_another_server_is_no_confirmation(other_server, path, status):
    with pytest.raises(OhmwardError, match=rf"\({status}.*\); check url"):
        write_lines(other_server + path, lines(rows(1), "rover"), "the secret")
    assert OtherServer.seen == [], "the token must not follow a redirection"


def test_rows_that_a_server_will_never_take_do_not_hold_up_the_others(tmp_path, caplog):
    port = free_port()
    with influxdb(tmp_path, port) as address:
        short = "CREATE RETENTION POLICY short ON robots DURATION 1h REPLICATION 1 DEFAULT"
        urllib.request.urlopen(f"{address}/query", urllib.parse.urlencode({"q": short}).encode(), timeout=60).read()
        old = Row("battery", NOW_NS - 5 * 3600 * 10**9, {"soc": 0.5})
        write_lines(f"{address}/write?db=robots", lines([old, *rows(5)], "rover"))
        assert in_influx(address) == 5
    assert "retention policy" in caplog.text


def test_robots_do_not_wait_for_each_other_in_postgresql(tmp_path):
    import psycopg

    with postgresql(tmp_path, free_port()) as address:
        write_rows(rows(1), "rover", address)
        with psycopg.connect(address) as connection:
            connection.execute("CREATE ROLE writer LOGIN")
            connection.execute("GRANT INSERT, SELECT ON ohmward_battery, ohmward_drive TO writer")
        with psycopg.connect(address) as other:  # another robot in the middle of its rows
            other.execute("INSERT INTO ohmward_battery VALUES ('other', 1, now(), '{}')")
            write_rows(rows(1, 1), "rover", address.replace("user=rover", "user=writer"))
            assert in_postgresql(address, "ohmward_battery") == 2


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: InfluxSink("db.local:8086"), "url must be http"),
        (lambda: InfluxSink("http://me:secret@db.local/write?db=x"), "must not hold a password"),
        (lambda: PostgresqlSink("postgresql://me:secret@db.local/robots"), "must not hold a password"),
        (lambda: PostgresqlSink("host=db password=secret"), "must not hold a password"),
        (lambda: PostgresqlSink("host=db password = secret"), "must not hold a password"),
        (lambda: PostgresqlSink("postgresql://db.local/robots?password=secret"), "must not hold a password"),
        (lambda: InfluxSink("http://db.local/write?db=x&u=me&p=secret"), "must not hold a password"),
        (lambda: InfluxSink("http://db/write", token="not a name"), "not the secret"),
    ],
)
def test_secrets_never_stand_in_a_setup(make, message):
    with pytest.raises(InputError, match=message) as refusal:
        make()
    assert "secret@" not in str(refusal.value)


def test_sinks_of_different_names_have_spools_of_their_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("here", "there"):
        feed = fed()
        feed.end()
        asyncio.run(InfluxSink("http://127.0.0.1:9/write?db=robots", name=name, interval_s=0.0).run(feed))
        assert Spool(tmp_path / "ohmward-state" / f"{name}.spool", 1000).waiting == 80


def test_an_address_with_a_port_and_no_password_is_taken():
    assert PostgresqlSink("postgresql://rover@db.local:5432/robots").address.endswith(":5432/robots")
    assert PostgresqlSink("postgresql://db.local:5432/robots").password is None
