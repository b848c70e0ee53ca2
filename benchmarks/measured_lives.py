"""Lives of measured cells, see `lives.py`: files from the tests that a user has, driven where those tests never were.

Nothing is tuned per file; each battery is identified with the defaults, from the tests that its row names.

[K] P. Kollmeyer et al., A blind modeling tool for standardized evaluation of battery state of charge estimation
algorithms, IEEE Transportation Electrification Conference, 2022.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np

import measured_cells as cells
from lives_table import SETTLED_S, LifeRow, disturbed, life_row
from measured_cells import Recording
from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery
from ohmward.errors import InputError

#: Largest RMSE from a right start, by temperature of the life: near 25, 5 and -10 degC ("life beyond the test bench").
ONE_TEMPERATURE = {"nmc": (0.01, 0.015, 0.025), "lfp": (0.01, 0.02, 0.03), "lead-acid": (0.015, 0.025, 0.04)}
TWO_TEMPERATURES = (0.008, 0.01, 0.02)


class Start(NamedTuple):
    """What an estimator is told at the beginning, and what its current sensor does.

    words: for the table.  error: of the SoC that it is told, None where it is told nothing.
    offset_C: offset of the sensor, in multiples of the capacity per hour.
    from_share: share of the life that has passed when the estimator is switched on.
    """

    words: str
    error: float | None = 0.0
    offset_C: float = 0.0
    from_share: float = 0.0


RIGHT = Start("right")
LOW = Start("30 points low", -0.3)
UNKNOWN = Start("unknown", None)

#: Sensors off by 50 mA, as a small robot's, and by 1 % of C.
OFFSETS_A = (0.05, -0.05)
ONE_PERCENT = Start("right, +1 % of C", offset_C=0.01)

#: A blind benchmark of the field [K]: a 4.6 Ah cell, offsets of 0.1 and 0.3 A, restarts in mid-drive with a wrong SoC.
BLIND = (
    Start("restart in mid-drive, unknown", None, from_share=0.5),
    Start("restart in mid-drive, 30 points low", -0.3, from_share=0.5),
    *(
        Start(f"restart in mid-drive, unknown, {ampere:+.1f} A on 4.6 Ah", None, ampere / 4.6, from_share=0.5)
        for ampere in (0.1, -0.1, 0.3, -0.3)
    ),
)

#: A trip of a car is short: its band is judged after five minutes.
TRIP_SETTLE_S = 300.0


class Case(NamedTuple):
    """A battery and a recording, made when they are needed, and the starts from which it is estimated.

    chemistry, cell, tested, lived, rmse_bar: as in `LifeRow`; the bar is that of a right start.
    settled_s: the band is judged after this time.
    """

    chemistry: str
    cell: str
    tested: str
    lived: str
    battery: Callable[[], Battery]
    recording: Callable[[], Recording]
    starts: Sequence[Start] = (RIGHT, LOW, UNKNOWN)
    rmse_bar: float | None = None
    settled_s: float = SETTLED_S


def rows() -> Iterator[LifeRow]:
    """Every measured life; a battery that its tests do not identify is skipped with a message.

    Raises:
        FileNotFoundError: data are absent; the caller skips this part and says so.
    """
    for case in (case for part in PARTS for case in part()):
        try:
            battery, recording = _battery(case.battery), case.recording()
        except InputError as refusal:
            print(f"{case.cell}, {case.tested}: {refusal}", file=sys.stderr)
            continue
        for start in case.starts:
            log, truth = _from(start, recording)
            if np.isfinite(truth[log.time_s - log.time_s[0] >= case.settled_s]).any():
                yield lived(case, battery, recording, start)
            else:
                print(f"{case.cell}, {case.lived}, {start.words}: over before it is judged", file=sys.stderr)


def _from(start: Start, recording: Recording) -> Recording:
    """The part of a recording from a start on."""
    log, truth = recording
    log = log.between(log.time_s[int(start.from_share * len(log))], np.inf)
    return log, truth[-len(log) :]


def lived(case: Case, battery: Battery, recording: Recording, start: Start) -> LifeRow:
    """The row of a case from one start."""
    log, truth = _from(start, recording)
    told = None if start.error is None else float(np.clip(truth[np.isfinite(truth)][0] + start.error, 0.0, 1.0))
    return life_row(
        case.chemistry,
        case.cell,
        case.tested,
        f"{case.lived}, {start.words}",
        battery,
        disturbed(log, start.offset_C * battery.capacity_Ah),
        truth,
        told,
        rmse_bar=_rmse_bar(case, start),
        settled_s=case.settled_s,
    )


def a123() -> Iterator[Case]:
    """LFP: from 25 degC, and from 25 and 5 degC, at -15 to 45 degC."""
    offsets = tuple(Start(f"right, {1000 * a:+.0f} mA", offset_C=a / cells.A123_AH) for a in OFFSETS_A)
    tests = {
        "low rate and drive at 25 degC": (_once(cells.a123_battery, 25), ONE_TEMPERATURE["lfp"]),
        "low rate and drive at 25 and 5 degC": (_once(cells.a123_battery, 25, 5), TWO_TEMPERATURES),
        "label": (_once(generic_battery, "lfp", cells.A123_AH), None),
    }
    for tested, (battery, bars) in tests.items():
        for degC in (45, 25, 5, -15):
            starts = (RIGHT, LOW, UNKNOWN, *(offsets if bars else ()))
            drive = partial(cells.a123, degC)
            yield Case("lfp", "A123", tested, f"drive at {degC} degC", battery, drive, starts, _bar_at(degC, bars))
        charge = partial(cells.a123_charge, 25)
        yield Case("lfp", "A123", tested, "charge at 25 degC", battery, charge, (RIGHT, UNKNOWN))


def panasonic() -> Iterator[Case]:
    """NCA: with and without the tests in the cold, with and without the tester's counter, at 25 to -10 degC."""
    tests = {
        "pulses and low rate at 25 degC": (_once(cells.panasonic_battery, 25), ONE_TEMPERATURE["nmc"]),
        "the same without the counter": (
            _once(cells.panasonic_battery, 25, counter=False),
            ONE_TEMPERATURE["nmc"],
        ),
        "pulses at 25 degC": (_once(cells.panasonic_battery, 25, low_rate=False), ONE_TEMPERATURE["nmc"]),
        "pulses at 25, 10, 0 degC": (_once(cells.panasonic_battery, 25, 10, 0), TWO_TEMPERATURES),
        "pulses at 25, 10, 0 degC without the counter": (
            _once(cells.panasonic_battery, 25, 10, 0, counter=False),
            TWO_TEMPERATURES,
        ),
        "label": (_once(generic_battery, "nca", cells.PANASONIC_AH), None),
    }
    lives = (("25degC_Cycle_1", 25), ("25degC_HWFTa", 25), ("0degC_Cycle_1", 0), ("n10degC_US06", -10))
    for tested, (battery, bars) in tests.items():
        for name, degC in lives:
            lived = f"{name.split('_', 1)[1].replace('_', ' ')} at {degC} degC"
            starts = (RIGHT, LOW, UNKNOWN, ONE_PERCENT)
            record = partial(cells.panasonic, name)
            yield Case("nca", "Panasonic", tested, lived, battery, record, starts, _bar_at(degC, bars))


#: Records of TU Eindhoven: the cell, the records that identify, the others.
TUE_SPLITS = (
    ("nmc", ("identification_data",), ("drive_cycle_data",)),
    ("nmc", ("drive_cycle_data",), ("identification_data",)),
    ("lfp", ("identification_data_first",), ("identification_data_second", "identification_data_third")),
    ("lfp", ("identification_data_second",), ("identification_data_first", "identification_data_third")),
    ("lfp", ("identification_data_first", "identification_data_second"), ("identification_data_third",)),
    (
        "nmc_with_temperature",
        ("identification_data_1_6",),
        ("identification_data_2_6", "identification_data_3_6", "identification_data_5_6"),
    ),
    (
        "nmc_with_temperature",
        ("identification_data_1_6", "identification_data_2_6"),
        ("identification_data_3_6", "identification_data_5_6"),
    ),
)


def tue() -> Iterator[Case]:
    """NMC, LFP, and NMC from 0 to 41 degC: the known OCV and some records identify, others are estimated."""
    for cell, tests, others in TUE_SPLITS:
        known = cells.TUE[cell]
        fifty_mA = Start("right, +50 mA", offset_C=0.05 / known.capacity_Ah)
        starts = (RIGHT, LOW, UNKNOWN, fifty_mA, ONE_PERCENT)
        battery = _once(cells.tue_battery, cell, *tests)
        tested = "OCV and " + " + ".join(map(short, tests))
        for record in others:
            yield Case(
                known.chemistry,
                f"TUE {cell}".replace("_", " "),
                tested,
                short(record),
                battery,
                partial(cells.tue, cell, record),
                starts,
            )


def others() -> Iterator[Case]:
    """Pouch cell at 40 and 10 degC, a cell with a label only, sealed lead-acid."""
    cold = {25: ("pulses at 25 degC", _once(cells.ornl_battery, 25), ONE_TEMPERATURE["nmc"])}
    cold[10] = ("pulses at 25 and 10 degC", _once(cells.ornl_battery, 25, 10), TWO_TEMPERATURES)
    for tested, battery, bars in cold.values():
        for degC in (40, 10):
            bar = _bar_at(degC, bars)
            yield Case(
                "nmc", "Leaf pouch", tested, f"pulses at {degC} degC", battery, partial(cells.ornl, degC), rmse_bar=bar
            )
    yield Case("nmc", "Samsung 20R", "label", "DST at 25 degC", _once(generic_battery, "nmc", 2.0), cells.calce)
    vrla = _once(cells.vrla_battery)
    bar = ONE_TEMPERATURE["lead-acid"][0]
    yield Case("lead-acid", "BBOXX", "two discharges", "third discharge", vrla, cells.vrla, rmse_bar=bar)


def ageing() -> Iterator[Case]:
    """Cells over weeks from their label; the truth is that of full discharges, whose ends differ by some points."""
    for cell in ("B0025", "B0027", "B0029", "B0031"):
        label = _once(generic_battery, "nca", cells.NASA_AH)
        yield Case("nca over weeks", f"NASA {cell}", "label", "weeks", label, partial(cells.nasa, cell), (UNKNOWN,))


def car() -> Iterator[Case]:
    """A car's battery from its label and from eight trips; the truth is what the car shows, an estimate as well."""
    tests = {
        "label": _once(generic_battery, "nmc", cells.I3_AH, cells.I3_CELLS),
        "eight other trips": _once(cells.i3_battery),
    }
    for tested, battery in tests.items():
        for trip in cells.I3_DRIVEN:
            record = partial(cells.i3, trip)
            yield Case("nmc in a car", "BMW i3", tested, trip, battery, record, (RIGHT, UNKNOWN), None, TRIP_SETTLE_S)


def blind() -> Iterator[Case]:
    """The protocol of [K] on cells that were tested at room temperature only."""
    a123_25, panasonic_25 = _once(cells.a123_battery, 25), _once(cells.panasonic_battery, 25)
    for degC in (45, 25, 5, -15):
        drive = partial(cells.a123, degC)
        tested = "blind: low rate and drive at 25 degC"
        yield Case("lfp", "A123", tested, f"drive at {degC} degC", a123_25, drive, BLIND)
        yield Case("lfp", "A123", tested, f"charge after {degC} degC", a123_25, partial(cells.a123_charge, degC), BLIND)
    for name, degC in (("25degC_Cycle_1", 25), ("0degC_Cycle_1", 0), ("n10degC_US06", -10)):
        tested = "blind: pulses and low rate at 25 degC"
        yield Case(
            "nca", "Panasonic", tested, f"drive at {degC} degC", panasonic_25, partial(cells.panasonic, name), BLIND
        )
    sweep = _once(cells.tue_battery, "nmc_with_temperature", "identification_data_1_6")
    record = partial(cells.tue, "nmc_with_temperature", "identification_data_2_6")
    yield Case("nmc", "TUE nmc with temperature", "blind: OCV and 1 6", "0 to 41 degC", sweep, record, BLIND)


PARTS: tuple[Callable[[], Iterator[Case]], ...] = (a123, panasonic, tue, others, ageing, car, blind)


def short(record: str) -> str:
    """Name of a record without what all of them share."""
    return record.removesuffix("_data").replace("identification_data", "record").replace("_", " ").strip()


def _rmse_bar(case: Case, start: Start) -> float | None:
    """Largest RMSE: a point more where the start is not known; for LFP only once its flat part was left, so none."""
    if case.rmse_bar is None or start.offset_C or start.from_share:
        return None
    if start.error == 0.0:
        return case.rmse_bar
    return None if case.chemistry == "lfp" else case.rmse_bar + 0.01


def _bar_at(degC: float, bars: tuple[float, ...] | None) -> float | None:
    """The bar nearest to this temperature of the life: those at 25, 5 and -10 degC."""
    if bars is None:
        return None
    return bars[0] if degC >= 15 else bars[1] if degC >= -2.5 else bars[2]


def _once(make: Callable[..., Battery], *tests: object, **options: object) -> Callable[[], Battery]:
    """The function that identifies this battery; the same object for the same tests."""
    return _made(make, tests, tuple(sorted(options.items())))


@cache
def _made(make: Callable[..., Battery], tests: tuple, options: tuple) -> Callable[[], Battery]:
    return partial(make, *tests, **dict(options))


@cache
def _battery(make: Callable[[], Battery]) -> Battery:
    """The battery, identified once."""
    return make()
