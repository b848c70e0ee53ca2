"""Names and rules of the Battery Data Format (BDF, Battery Data Alliance, ontology 1.2): current > 0 charges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ohmward.errors import InputError
from ohmward.logs.columns import listed
from ohmward.logs.units import split_unit

SUFFIXES = (".bdf.csv", ".bdf.parquet")
# Log field -> preferred label, machine name, and for the wall clock ohmward's own name.
NAMES: Mapping[str, tuple[str, ...]] = {
    "time_s": ("Test Time / s", "test_time_second"),
    "voltage_V": ("Voltage / V", "voltage_volt"),
    "current_A": ("Current / A", "current_ampere"),
    "temperature_degC": ("Temperature T1 / degC", "temperature_t1_celsius"),
    "unix_time_s": ("Unix Time / s", "unix_time_second", "unix_time_s"),
}
REQUIRED = ("time_s", "voltage_V", "current_A")


def is_bdf(file: str) -> bool:
    """True where the suffix of a file's name says that it is BDF."""
    return file.lower().endswith(SUFFIXES)


def has_columns(names: Sequence[str]) -> bool:
    """True where the three required columns have their BDF names."""
    return all(set(NAMES[field]) & set(names) for field in REQUIRED)


def check_names(file: str, names: Sequence[str]) -> None:
    """Refuse a file that calls itself BDF and lacks a required column.

    Raises:
        InputError: names the columns that are missing.
    """
    known = set(map(_quantity, names))
    lacking = [NAMES[field][0] for field in REQUIRED if known.isdisjoint(map(_quantity, NAMES[field]))]
    if is_bdf(file) and lacking:
        raise InputError(
            f"{file}: BDF requires the columns {listed([NAMES[field][0] for field in REQUIRED])}; missing: "
            f"{listed(lacking)}; it has: {listed(names)}; rename the columns, or the file so that it is not called BDF"
        )


def _quantity(name: str) -> tuple[str, str]:
    """What a name calls its quantity, and the dimension of its unit, "" for none."""
    stem, unit = next(split_unit(name))
    return stem, unit.dimension if unit else ""
