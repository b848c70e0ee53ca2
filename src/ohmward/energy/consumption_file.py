"""The consumption table: the learned consumption of a robot as TOML, which is also its snapshot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.atomic import write_text
from ohmward.energy.consumption import SHARED, Consumption, Variance, Visits, start
from ohmward.energy.consumption_prior import ConsumptionPrior
from ohmward.energy.discharge_end import DischargeEnd
from ohmward.errors import InputError
from ohmward.optional import require
from ohmward.toml_file import parse_file, parse_toml

FORMAT = "ohmward-consumption/1"
_HEADER = """\
# What a robot takes from its battery, as ohmward has learned it from drives. The coefficients and their covariance are
# what is read back; these lines are for people, and are rewritten each time.
"""
_TABLES = ("prior", "scatter", "day", "idle_noise", "terrain", "coefficients", "end")


def save_consumption(c: Consumption, path: str | PathLike[str]) -> None:
    """Write the table to a file, complete or not at all.

    >>> ow.save_consumption(ow.load_consumption("table.toml"), "copy.toml")

    Raises:
        OhmwardError: the file cannot be written.
    """
    write_text(Path(path), dump_consumption(c))


def load_consumption(path: str | PathLike[str]) -> Consumption:
    """Load the table from a file.

    >>> ow.load_consumption("table.toml").terrains
    ('grass',)

    Raises:
        InputError: the file cannot be read or is not a consumption table; names file, key, rule and fix.
    """
    return parse_file(path, parse_consumption, "consumption table")


def dump_consumption(c: Consumption) -> str:
    """The text of the table; every digit is kept, so that it reads back bit for bit."""
    tomli_w = require("tomli_w", "writing TOML")

    clock = {} if c.last_drive_unix_s is None else {"last_drive_unix_s": float(c.last_drive_unix_s)}
    end = {} if c.end is None else {"end": c.end._asdict()}
    data = {
        "format": FORMAT,
        **clock,
        **end,
        "prior": asdict(c.prior),
        "scatter": c.scatter._asdict(),
        "day": c.day._asdict(),
        "idle_noise": c.idle_noise._asdict(),
        "terrain": [
            {"name": name, **v._asdict(), "reference_N": force_N, "on_this_drive": name in c.on_this_drive}
            for name, v, force_N in zip(c.terrains, c.visits, c.reference_N, strict=True)
        ],
        "coefficients": {"names": list(c.names), "mean": c.mean.tolist(), "cov": c.cov.tolist()},
    }
    lines = [_line(c, name) for name in c.terrains]
    return "\n".join([_HEADER + "#", *lines, "", tomli_w.dumps(data)])


def parse_consumption(text: str) -> Consumption:
    """Parse the text of a table.

    Raises:
        InputError: not TOML, another format, a missing key or a value of the wrong type.
    """
    data = parse_toml(text)
    if (found := data.get("format")) != FORMAT:
        raise InputError(f'format must be "{FORMAT}", got {found!r}; a consumption table starts with that line')
    if unknown := sorted(set(data) - {"format", "last_drive_unix_s", *_TABLES}):
        raise InputError(f"{unknown[0]} is not a key of a consumption table; there are: {', '.join(_TABLES)}")
    try:
        return _from_tables(data)
    except KeyError as error:
        raise InputError(f"the key {error.args[0]} is missing; learn the table again") from error
    except (TypeError, ValueError) as error:
        raise InputError(f"holds something of another kind than expected ({error}); learn the table again") from error


def _from_tables(data: Mapping[str, Any]) -> Consumption:
    terrains, prior = data.get("terrain", []), ConsumptionPrior(**data["prior"])
    c = Consumption(
        prior,
        tuple(str(t["name"]) for t in terrains),
        np.array(data["coefficients"]["mean"], dtype=float),
        np.array(data["coefficients"]["cov"], dtype=float),
        tuple(float(t["reference_N"]) for t in terrains),
        _numbers(Variance, data["scatter"]),
        _numbers(Variance, data["day"]),
        _numbers(Variance, data["idle_noise"]) if "idle_noise" in data else start(prior).idle_noise,
        tuple(Visits(*(t[name] for name in Visits._fields)) for t in terrains),
        tuple(t["name"] for t in terrains if t["on_this_drive"]),
        data.get("last_drive_unix_s"),
        _numbers(DischargeEnd, data["end"]) if "end" in data else None,
    )
    if list(c.names) != list(data["coefficients"]["names"]):
        raise InputError(
            f"coefficients.names must be {', '.join(SHARED)} and two for each terrain in their order; "
            "learn the table again"
        )
    return c


def _numbers(kind: Any, table: Mapping[str, Any]) -> Any:
    """The record of numbers in a table."""
    return kind(*(float(table[name]) for name in kind._fields))


def _line(c: Consumption, name: str) -> str:
    k, v = c.force_index(name), c.visits[c.terrains.index(name)]
    std_N = np.sqrt(c.cov[k, k])
    driven = f"{v.distance_m:.0f} m, drives: {v.drives}"
    measured = f", {v.energy_J / v.distance_m:.3g} J/m measured" if v.distance_m else ""
    return f"#   {name}: resistance {c.mean[k]:.3g} N, std {std_N:.2g} N; {driven}{measured}"
