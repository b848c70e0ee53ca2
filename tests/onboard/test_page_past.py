"""History of the page: from memory, and before that from the store."""

import asyncio
import json
import urllib.error
import urllib.request

import pytest

from ohmward.errors import OhmwardError
from ohmward.onboard.assembly import sinks_of
from ohmward.onboard.page.dashboard import SPANS, Past, Rows, stored_rows, thinned
from ohmward.onboard.page.view import HISTORY
from ohmward.onboard.robot_setup import Setup
from ohmward.onboard.sinks.page import PageSink
from ohmward.onboard.sinks.store import StoreSink
from onboard.page_server import NOW_S, dashboard_with, drive, served, stored


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("store")
    stored(folder, 30.0)

    async def dashboard():
        return dashboard_with(folder)

    with served(dashboard=asyncio.run(dashboard())) as address:
        yield address


def get(url):
    try:
        with urllib.request.urlopen(url, timeout=60) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as answer:
        return answer.code, json.load(answer)


@pytest.mark.parametrize("name", SPANS)
def test_the_api_goes_back_beyond_memory(page, name):
    status, rows = get(f"{page}/api/history?last={name}")
    times = rows["unix_s"]
    assert status == 200 and set(rows) == set(HISTORY)
    assert times == sorted(times) and len(times) == len(set(times)) < 600
    assert times[-1] == pytest.approx(drive()[-1].unix_s, abs=SPANS[name].step_s)
    reach_s = min(SPANS[name].length_s, 30 * 3600.0)
    assert NOW_S - times[0] == pytest.approx(reach_s, abs=2 * SPANS[name].step_s)
    first = {column: values[0] for column, values in rows.items()}
    assert first["power_W"] == 26.0 and first["slip_ratio"] == -0.3 and first["speed_m_s"] == 0.5
    assert first["soc_low"] < first["soc"] < first["soc_high"] and first["range_m"] == 900.0
    assert len(get(f"{page}/api/history?last={name}&since={NOW_S}")[1]["soc"]) < len(rows["soc"])


def test_another_time_is_refused_and_without_one_memory_answers(page):
    status, said = get(f"{page}/api/history?last=year")
    assert status == 400 and said["error"] == "last must be one of hour, day, week"
    assert get(f"{page}/api/history")[1]["unix_s"][0] >= NOW_S


def test_the_time_in_which_the_robot_was_off_is_empty(tmp_path):
    stored(tmp_path, 2.0, until_s=NOW_S - 10 * 3600.0)
    stored(tmp_path, 1.0)
    rows = stored_rows(tmp_path, NOW_S, SPANS["day"])
    times = [unix_s or 0.0 for unix_s in rows["unix_s"]]
    (gap,) = (k for k, soc in enumerate(rows["soc"]) if soc is None)
    assert times[gap - 1] < NOW_S - 10 * 3600.0 < times[gap] < NOW_S - 3600.0 <= times[gap + 1]


def test_the_store_is_read_once_for_all_readers_and_its_faults_are_named(tmp_path, monkeypatch, caplog):
    calls = []

    def read(*arguments):
        calls.append(arguments)
        raise OhmwardError("store.sqlite: cannot be read")

    monkeypatch.setattr("ohmward.onboard.page.dashboard.stored_rows", read)

    async def ask():
        past = Past(dashboard_with(tmp_path))
        return await asyncio.gather(*(past.last("day") for _ in range(20)))

    answers = asyncio.run(ask())
    assert len(calls) == 1 and "no history of the store: store.sqlite: cannot be read" in caplog.text
    assert all(answer["unix_s"][-1] >= NOW_S for answer in answers), "memory goes on"


def test_a_page_finds_the_store_beside_it():
    setup = Setup(robot="rlma", sink=(StoreSink("here"), PageSink()))
    assert [sink.store for sink in sinks_of(setup) if isinstance(sink, PageSink)] == ["here"]
    own = Setup(robot="rlma", sink=(StoreSink("here"), PageSink(store="there")))
    assert [sink.store for sink in sinks_of(own) if isinstance(sink, PageSink)] == ["there"]
    alone = Setup(robot="rlma", sink=(PageSink(),))
    assert sinks_of(alone)[0] == PageSink()


def test_rows_of_memory_are_thinned_to_a_step():
    rows: Rows = {name: [float(k) for k in range(1000)] for name in HISTORY}
    assert thinned(rows, 20.0)["unix_s"] == [float(k) for k in range(0, 1000, 20)]
    assert thinned({name: [] for name in HISTORY}, 20.0)["unix_s"] == []
