"""Dashboards of Grafana for each server, from one table of panels: `python -m ohmward.onboard.store.dashboards FOLDER`.

Grafana imports the JSON and asks for the data source. They are written from the names that the store has, so that a
panel cannot ask for a column that there is not; they were not shown in a Grafana.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ohmward.atomic import write_text

#: Kind of data source for each server.
SERVERS = {"influxdb": "influxdb", "victoria-metrics": "prometheus", "postgresql": "grafana-postgresql-datasource"}


class Panel(NamedTuple):
    """A panel: its title, unit as Grafana names it, kind of rows and the columns that it draws."""

    title: str
    unit: str
    kind: str
    columns: Sequence[str]


PANELS = (
    Panel("Charge and one sigma of it", "percentunit", "battery", ("soc", "soc_std")),
    Panel("Range left: 90 %, median, 10 %", "lengthm", "battery", ("range_p10_m", "range_p50_m", "range_p90_m")),
    Panel("Voltage", "volt", "battery", ("battery_voltage_V",)),
    Panel("Current, > 0 charges", "amp", "battery", ("battery_current_A",)),
    Panel("Capacity and resistance, new is 1", "percentunit", "battery", ("soh_capacity", "resistance_ratio")),
    Panel("Temperature", "celsius", "battery", ("battery_temperature_degC",)),
    Panel("Speed", "velocityms", "drive", ("estimated_speed_m_s", "estimated_speed_std_m_s")),
    Panel("Distance driven", "lengthm", "drive", ("distance_m",)),
)  # fmt: skip

_WIDTH, _HEIGHT, _ACROSS = 12, 8, 2


def dashboard(server: str) -> dict[str, Any]:
    """The dashboard for a server: a name of `SERVERS`."""
    source = {"type": SERVERS[server], "uid": "${source}"}
    panels = [_panel(k, panel, server, source) for k, panel in enumerate(PANELS)]
    return {
        "title": "ohmward robot",
        "uid": f"ohmward-{server}",
        "tags": ["ohmward"],
        "schemaVersion": 39,
        "refresh": "10s",
        "time": {"from": "now-1h", "to": "now"},
        "templating": {"list": [_source_variable(server), _robot_variable(server, source)]},
        "panels": panels,
    }


def _panel(k: int, panel: Panel, server: str, source: dict[str, str]) -> dict[str, Any]:
    place = {"x": k % _ACROSS * _WIDTH, "y": k // _ACROSS * _HEIGHT, "w": _WIDTH, "h": _HEIGHT}
    targets = [
        {"refId": chr(ord("A") + n), "datasource": source, **_query(server, panel.kind, column)}
        for n, column in enumerate(panel.columns)
    ]
    return {
        "id": k + 1,
        "type": "timeseries",
        "title": panel.title,
        "gridPos": place,
        "datasource": source,
        "fieldConfig": {"defaults": {"unit": panel.unit}, "overrides": []},
        "targets": targets,
    }


def _query(server: str, kind: str, column: str) -> dict[str, Any]:
    """The query of one column, in the language of the server."""
    if server == "influxdb":
        where = '"robot" =~ /^$robot$/ AND $timeFilter GROUP BY time($__interval) fill(null)'
        return {"rawQuery": True, "alias": column, "query": f'SELECT mean("{column}") FROM "{kind}" WHERE {where}'}
    if server == "victoria-metrics":
        return {"expr": f'avg_over_time({kind}_{column}{{robot=~"$robot"}}[$__interval])', "legendFormat": column}
    where = "robot IN ($robot) AND $__timeFilter(at) GROUP BY 1 ORDER BY 1"
    value = f"avg((values->>'{column}')::float8)"
    sql = f'SELECT $__timeGroup(at, $__interval) AS time, {value} AS "{column}" FROM ohmward_{kind} WHERE {where}'
    return {"rawQuery": True, "format": "time_series", "rawSql": sql}


def _source_variable(server: str) -> dict[str, Any]:
    return {"name": "source", "label": "data source", "type": "datasource", "query": SERVERS[server]}


def _robot_variable(server: str, source: dict[str, str]) -> dict[str, Any]:
    queries = {
        "influxdb": 'SHOW TAG VALUES WITH KEY = "robot"',
        "victoria-metrics": "label_values(battery_soc, robot)",
        "postgresql": "SELECT DISTINCT robot FROM ohmward_battery",
    }
    return {
        "name": "robot",
        "type": "query",
        "datasource": source,
        "query": queries[server],
        "refresh": 2,
        "multi": True,
        "includeAll": True,
        "current": {"text": "All", "value": "$__all"},
    }


def write_dashboards(folder: Path) -> list[Path]:
    """Write the dashboards of all servers; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"grafana-{server}.json" for server in SERVERS]
    for server, path in zip(SERVERS, paths, strict=True):
        write_text(path, json.dumps(dashboard(server), indent=1) + "\n")
    return paths


if __name__ == "__main__":
    for written in write_dashboards(Path(sys.argv[1] if len(sys.argv) > 1 else ".")):
        print(written)
