"""The dashboards of the documentation ask for what the store has, and the servers answer their queries."""

import json
import re
import urllib.parse
import urllib.request
from functools import cache

import pytest

from markdown_pages import ROOT
from ohmward.onboard.sinks.server import lines, write_lines, write_rows
from ohmward.onboard.store.rows import Row, RowMaker
from onboard.page_server import drive
from onboard.servers import free_port, influxdb, postgresql, victoria_metrics
from onboard.test_store_servers import NOW_NS


def targets(server):
    panels = json.loads((ROOT / f"docs/dashboards/grafana-{server}.json").read_text(encoding="utf-8"))["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    return [target for panel in panels for target in panel["targets"]]


#: Kind of row and column of every query, as those for InfluxDB name them.
COLUMNS = {
    (kind, name) for t in targets("influxdb") for name, kind in re.findall(r'mean\("(\w+)"\) FROM "(\w+)"', t["query"])
}


@cache
def stored() -> list[Row]:
    """Rows with every column that a panel draws."""
    maker = RowMaker()
    rows = [row for state in drive() for row in maker.rows(state)]
    missing = COLUMNS - {(row.kind, name) for row in rows for name in row.values}
    assert {name for _, name in missing} <= {f"range_{p}_m" for p in ("p10", "p50", "p90")}, "no such column"
    ranges = dict.fromkeys(("range_p10_m", "range_p50_m", "range_p90_m"), 100.0)
    return [Row(row.kind, NOW_NS + row.unix_ns % 10**9, {**row.values, **ranges}) for row in rows]


def test_influxdb_answers_every_panel(tmp_path):
    with influxdb(tmp_path, free_port()) as address:
        write_lines(f"{address}/write?db=robots", lines(stored(), "rover"))
        for target in targets("influxdb"):
            lately = f"time > {NOW_NS - 3600 * 10**9}"  # from 1970 on the server would fill half a million hours
            query = target["query"].replace("/^$robot$/", "/^rover$/").replace("$timeFilter", lately)
            query = urllib.parse.urlencode({"db": "robots", "q": query.replace("$__interval", "1h")})
            with urllib.request.urlopen(f"{address}/query?{query}", timeout=60) as answer:
                assert json.load(answer)["results"][0]["series"], target


def test_victoria_metrics_answers_every_panel(tmp_path):
    with victoria_metrics(tmp_path, free_port()) as address:
        write_lines(f"{address}/write", lines(stored(), "rover"))
        urllib.request.urlopen(f"{address}/internal/force_flush", timeout=60).read()
        for target in targets("victoria-metrics"):
            expression = target["expr"].replace("$robot", "rover").replace("$__interval", "1h")
            query = urllib.parse.urlencode({"query": expression, "time": NOW_NS / 1e9 + 60, "nocache": 1})
            with urllib.request.urlopen(f"{address}/api/v1/query?{query}", timeout=60) as answer:
                assert json.load(answer)["data"]["result"], target


def test_postgresql_answers_every_panel(tmp_path):
    psycopg = pytest.importorskip("psycopg")
    with postgresql(tmp_path, free_port()) as address:
        write_rows(stored(), "rover", address)
        with psycopg.connect(address) as connection:
            for target in targets("postgresql"):
                sql = target["rawSql"].replace("$robot", "'rover'").replace("$__timeFilter(at)", "at IS NOT NULL")
                sql = sql.replace("$__timeGroup(at, $__interval)", "date_trunc('hour', at)")
                assert connection.execute(sql).fetchone()[1] is not None, target
