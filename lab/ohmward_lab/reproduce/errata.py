"""All errors found in the texts we worked from, and their checks."""

from __future__ import annotations

from collections.abc import Sequence

from ohmward_lab.reproduce import errata_circuit, errata_filters, errata_robot
from ohmward_lab.reproduce.row import Erratum

ERRATA: tuple[Erratum, ...] = (*errata_circuit.ERRATA, *errata_filters.ERRATA, *errata_robot.ERRATA)


def check(errata: Sequence[Erratum]) -> list[bool]:
    """Results of the checks, in the same order."""
    return [bool(erratum.check()) for erratum in errata]
