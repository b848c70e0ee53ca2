"""Rows in PostgreSQL: a table for each kind, one row for each robot and time, its values as JSON.

CREATE TABLE ohmward_battery (robot text, unix_ns bigint, at timestamptz, values jsonb, PRIMARY KEY (robot, unix_ns))
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from ohmward.errors import OhmwardError
from ohmward.onboard.store.rows import KINDS, Row
from ohmward.optional import require

#: A server that does not answer within this is away [s].
TIMEOUT_S = 20

_TABLES = "; ".join(
    f"CREATE TABLE IF NOT EXISTS ohmward_{kind} (robot text NOT NULL, unix_ns bigint NOT NULL, "
    "at timestamptz NOT NULL, values jsonb NOT NULL, PRIMARY KEY (robot, unix_ns)); "
    f"CREATE INDEX IF NOT EXISTS ohmward_{kind}_at ON ohmward_{kind} (at)"
    for kind in KINDS
)


def write(rows: Sequence[Row], robot: str, address: str, password: str = "") -> None:
    """Write rows in one transaction; a row that is written again changes nothing.

    address: `host=db.local port=5432 dbname=robots user=rover` or `postgresql://rover@db.local/robots`.

    Raises:
        OhmwardError: the server cannot be reached or refuses.
    """
    psycopg = require("psycopg", "the sink postgresql")
    options: dict[str, Any] = {"connect_timeout": TIMEOUT_S} | ({"password": password} if password else {})
    try:
        with psycopg.connect(address, **options) as connection, connection.cursor() as cursor:
            cursor.execute(f"SET statement_timeout = {TIMEOUT_S * 1000}")
            cursor.execute("SELECT " + " AND ".join(f"to_regclass('ohmward_{kind}') IS NOT NULL" for kind in KINDS))
            if cursor.fetchone() != (True,):  # each takes a lock on which robots would wait for each other
                cursor.execute(_TABLES)
            for kind in KINDS:
                values = [
                    (robot, row.unix_ns, row.unix_ns / 1e9, json.dumps(row.values)) for row in rows if row.kind == kind
                ]
                insert = f"INSERT INTO ohmward_{kind} VALUES (%s, %s, to_timestamp(%s), %s) ON CONFLICT DO NOTHING"
                cursor.executemany(insert, values)
    except psycopg.Error as error:
        reason = " ".join(str(error).split())
        raise OhmwardError(f"PostgreSQL takes no rows ({reason}); is the server running, and address right?") from error
