"""The column of each channel, found by its name, and the unit in that name."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

from ohmward.errors import InputError
from ohmward.logs.channels import (
    BATTERY,
    CURRENT,
    IN,
    OUT,
    TEMPERATURE,
    TIME,
    VOLTAGE,
    Channel,
    channel_of,
    letters,
    word_set,
)
from ohmward.logs.dates import has_date, has_time_of_day
from ohmward.logs.units import UNITS, Unit, split_unit, unit_in_brackets, unit_in_name, unit_of

# Words that make a column something other than a measurement of the battery.
_OTHER_WORDS = word_set(
    "true truth std sigma var limit max min set setpoint target reference error residual predicted estimated estimate "
    "model step open circuit ocv delta offset bias nanosec nsecs nsec low high lowest highest"
)
# Words of what has a temperature of its own.
_OTHER_DEVICES = word_set(
    "inverter converter motor mos mosfet fet igbt board pcb cpu mcu esc controller driver charger"
)
# Words of clocks that may be set while a log runs.
_WALL_CLOCK = word_set("stamp date unix epoch dpt realtime datum fecha changed stempel horodatage 绝对 日期 日時")
# Words of the time since the start of a test; next to such a column `Time` is that of a step.
_WHOLE_TIME = word_set("total test elapsed seconds prog program run cumulative absolute gesamt 总 测试 累计 绝对")
#: A word longer than this that is at least this similar to a known one may be a misspelling.
_SHORTEST_MISSPELLED, _SIMILAR = 4, 0.75
# Ranks of the ways in which a name may fit a channel; 0 is best.
_BESIDE = (0, 1, 2, 4)
_BARE_LETTER, _NUMBERED, _WALL_CLOCK_TIME, _OF_AUXILIARY = 2, 2, 3, 3
_NOTATED, _OF_CHANNEL, _LAST_WORD, _NEVER = 4, 5, 5, 99
#: Times by their names, but a processor's clock or a thread's id beside another time.
_CLOCK_OR_ID = word_set("clock tid")
_TEMPERATURES = word_set("temp temps tmp temperature")
#: A temperature, if another column is the time.
_TEMPERATURE = "T"
#: A vehicle's auxiliary battery.
_AUXILIARY = re.compile(r"\b12 ?v\b|\baux", re.IGNORECASE)
#: A numbered channel of an instrument: `CH101(V)`, `Chan 101 (VDC)`.
_CHANNEL = re.compile(r"\bch(?:an(?:nel)?)?[ _]?(?=\d)", re.IGNORECASE)
#: Names of a quantity that stand for another one without its unit: the imaginary part, ambient temperature.
_WITH_UNIT_ONLY = ({"im"}, {"vf"}, {"at"}, {"test"})
#: Quantities that the unit alone identifies, in a column of a battery.
_BY_UNIT = (CURRENT, VOLTAGE, TEMPERATURE)


class UnclearColumnsError(InputError):
    """The names do not show which column holds a quantity, or several."""

    def __init__(
        self,
        source: str,
        names: Sequence[str],
        faults: Mapping[str, str],
        choice: Mapping[str, str | None],
        ties: Sequence[str] = (),
    ):
        self.faults = faults  #: quantity -> its fault, a clause
        #: quantity -> the columns that fit it equally well, none if it has none
        self.ties = dict.fromkeys(choice, ties)
        self.choice = choice  #: quantity -> a column that may hold it, None if none has a similar name
        given = {quantity: name or "NAME" for quantity, name in choice.items()}
        options = [f"{quantity}={name}" for quantity, name in given.items()]
        flags = " ".join(f"--column {argument(option)}" for option in options)
        interval = (
            ", or give the interval between rows with --sample-time 1 (FileHints(sample_time_s=1))"
            if "time" in choice
            else ""
        )
        super().__init__(
            f"{source}: {'; '.join(faults.values())}; it has: {listed(names)}; choose with {flags} "
            f"(columns={given}){interval}",
            () if None in choice.values() else [word for option in options for word in ("--column", option)],
        )


#: Endings of columns of fractions of a second beside whole seconds, and the lengths of their units [ns]: `stamp.sec`,
#: `stamp.nanosec`; `sec`, `usec`.
_FRACTIONS = {"nanosec": 1.0, "nsecs": 1.0, "nsec": 1.0, "usecs": 1e3, "usec": 1e3, "msecs": 1e6, "msec": 1e6}


def fraction_column(names: Sequence[str], name: str) -> tuple[str, float] | None:
    """The column of the fractions that belong to the whole seconds in `name`, and its unit [ns]; None without one."""
    stem = re.sub(r"secs?$", "", name)
    found = ((stem + end, unit_ns) for end, unit_ns in _FRACTIONS.items() if stem != name and stem + end in names)
    return next(found, None)


class Column(NamedTuple):
    """A column chosen for a quantity; `unit` is None if its name gives none."""

    name: str
    unit: Unit | None


def find_columns(
    source: str,
    names: Sequence[str],
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    head: Mapping[str, Sequence[str]] | None = None,
) -> dict[str, Column]:
    """The column of each quantity of a battery: `current_A`, `Current / mA`, `I (A)`, `pack.voltage`, `timestamp_ns`.

    Names of the whole battery take precedence over names of a cell, and those over names that merely end in the word.

    source: the file's name, for messages.
    names: the columns of the file.
    columns: quantity -> column name, where the caller knows better.
    units: quantity -> unit ("mA", "mV", "ms", "K", ...), where the name gives none or a wrong one.
    head: column -> its first cells, from which a time column may be guessed.
    Returns: quantity -> Column; temperature may be missing.

    Raises:
        UnclearColumnsError: quantities are missing, or two columns fit equally well; names all of them.
        InputError: an override names something that does not exist, or one column for two quantities; a file that calls
            itself BDF lacks a required column.
    """
    columns = columns or {}
    units = units or {}
    _require_bdf_columns(source, names)
    known = [channel.name for channel in BATTERY]
    if unknown := [quantity for quantity in (*columns, *units) if quantity not in known]:
        raise InputError(f"unknown quantity {unknown[0]!r}; ohmward knows {', '.join(known)}")
    chosen: dict[str, Column] = {}
    unclear: list[UnclearColumnsError] = []
    for channel in BATTERY:
        try:
            if found := find_column(source, names, channel, columns, units):
                chosen[channel.name] = found
        except UnclearColumnsError as error:
            unclear.append(error)
    time = chosen.get(TIME.name)
    if TEMPERATURE.name not in chosen and _TEMPERATURE in names and time and time.name != _TEMPERATURE:
        chosen[TEMPERATURE.name] = Column(_TEMPERATURE, None)
    _require_a_column_each(source, chosen)
    _require_one_battery(source, names, {q: c.name for q, c in chosen.items() if q not in columns}, unclear)
    if unclear:
        raise _with_suggestions(source, names, chosen, unclear, head or {})
    return chosen


def _require_a_column_each(source: str, chosen: Mapping[str, Column]) -> None:
    """Raise InputError where two quantities have one column."""
    owner: dict[str, str] = {}
    for quantity, column in chosen.items():
        if (other := owner.setdefault(column.name, quantity)) != quantity:
            raise InputError(
                f"{source}: column {column.name!r} cannot be both the {other} and the {quantity}; choose another with "
                f"--column {quantity}=NAME (columns={{{quantity!r}: NAME}})"
            )


def _require_one_battery(
    source: str, names: Sequence[str], found: Mapping[str, str], unclear: Sequence[UnclearColumnsError]
) -> None:
    """Raise InputError for columns of several batteries, with those of each; found: quantity -> column not named."""
    ties = {quantity: fits for error in unclear for quantity, fits in error.ties.items()}
    for quantity in {CURRENT.name, VOLTAGE.name} & found.keys():
        if (again := unique_names([found[quantity]] * 2))[1] in names:
            ties[quantity] = again
    if batteries := _batteries(dict(sorted(ties.items()))):
        flags = [[f"{quantity}={name}" for quantity, name in battery.items()] for battery in batteries]
        each = (" ".join(f"--column {argument(flag)}" for flag in of_one) for of_one in flags)
        raise InputError(
            f"{source}: columns of {len(batteries)} batteries, or tables side by side; choose one with "
            f"{' or '.join(each)} (columns={batteries[0]})"
        )


def _with_suggestions(
    source: str,
    names: Sequence[str],
    chosen: Mapping[str, Column],
    unclear: Sequence[UnclearColumnsError],
    head: Mapping[str, Sequence[str]],
) -> InputError:
    """One error for all quantities that are not clear, with a column for each that no other quantity has."""
    faults = {quantity: fault for error in unclear for quantity, fault in error.faults.items()}
    choice = {quantity: name for error in unclear for quantity, name in error.choice.items()}
    free = [name for name in names if name not in {column.name for column in chosen.values()}]
    if not free and TIME.name in chosen:
        return InputError(
            f"{source}: {'; '.join(faults.values())}; it has no more than {listed(names)}; a state of charge needs "
            "current and voltage of the battery: record both"
        )
    choice |= {q: _nearest(free, channel_of(q)) for q, name in choice.items() if name and name not in free}
    choice = {q: name if list(choice.values()).count(name) == 1 else None for q, name in choice.items()}
    if TIME.name in choice:
        tied = [name for error in unclear for name in error.ties.get(TIME.name, ())]
        # a mere number of the row counts up as well
        times = [name for name in tied or free if _are_times(head.get(name, ()))]
        stated = [name for name in times if unit_in_name(name, TIME.dimensions) or has_date(head[name][0])]
        choice[TIME.name] = next(iter([*stated, *times]), choice[TIME.name])
    return UnclearColumnsError(source, names, faults, choice)


def _batteries(ties: Mapping[str, Sequence[str]]) -> list[dict[str, str]]:
    """The columns of each of several batteries, where each quantity has as many, and names that match.

    ties: quantity -> the columns that fit it equally well.
    """
    if len(ties) < 2 or not all(ties.values()):
        return []
    first = next(iter(ties))
    batteries = [
        {quantity: min(fits, key=partial(_differences, name)) for quantity, fits in ties.items()}
        for name in ties[first]
    ]
    match = all(sorted(battery[q] for battery in batteries) == sorted(ties[q]) for q in ties)
    return batteries if match else []


def _differences(name: str, other: str) -> int:
    """Number of words and numbers in which two names differ; those of different length differ in all."""
    a, b = (re.findall(r"[^\W\d_]+|\d+", one) for one in (name, other))
    return sum(one != another for one, another in zip(a, b, strict=True)) if len(a) == len(b) else len(a) + len(b)


def unique_names(names: Sequence[str]) -> tuple[str, ...]:
    """The names, with a number before the unit of repeated ones: `Temp`, `Temp 2`; `I 2 [A]`."""
    unique: list[str] = []
    taken: set[str] = set()
    numbers: dict[str, int] = {}  # the next of each repeated name
    for name in names:
        stem, unit = split_unit(name)[0]
        free = name
        while free and free in taken:
            number = numbers.get(name, 2)
            free = f"{stem} {number} [{unit.symbol}]" if unit else f"{name} {number}"
            numbers[name] = number + 1
        unique.append(free)
        taken.add(free)
    return tuple(unique)


def other_times(names: Sequence[str], chosen: Collection[str]) -> list[Column]:
    """The columns other than the chosen ones that may be the time, the best first."""
    ranked = [(rank, column) for name in names if name not in chosen for rank, column in _ranks(TIME, name)]
    return [column for rank, column in sorted(ranked, key=lambda one: one[0]) if rank < _NEVER]


def find_column(
    source: str,
    names: Sequence[str],
    channel: Channel,
    columns: Mapping[str, str],
    units: Mapping[str, str],
    leave: Collection[str] = (),
    optional: bool = False,
) -> Column | None:
    """The column of one channel; None only if it is not required. Arguments as in `find_columns`.

    leave: columns that must not be guessed.
    optional: not even a required one is.
    """
    quantity = channel.name
    free = [name for name in names if name not in {*columns.values(), *leave}]
    if quantity in columns:
        column = named_column(source, names, quantity, columns[quantity], quantity in units)
    elif fitting := _best(source, free, channel):
        column = fitting
    elif channel.required and not optional:
        near = _nearest(names, channel)
        fault = f"no column for the {quantity} found"
        counters = [n for n in free if (unit := split_unit(n)[0][1]) and unit.dimension in ("charge", "energy")]
        if channel is CURRENT and counters:
            fault += f" (charge or energy is counted in {listed(counters)}: log the current beside it)"
        raise UnclearColumnsError(source, names, {quantity: fault}, {quantity: near})
    else:
        return None
    return column._replace(unit=given_unit(quantity, units[quantity])) if quantity in units else column


def named_column(source: str, names: Sequence[str], quantity: str, wanted: str, unit_is_given: bool = False) -> Column:
    """The column that the caller named, in any case; InputError for none, or one in a unit of another quantity."""
    exact = [name for name in names if name == wanted] or [n for n in names if n.lower() == str(wanted).lower()]
    exact = exact or [name for name in names if name.startswith(f"{wanted} [")]  # the unit stood in a row or in cells
    if not exact:
        raise InputError(
            f"{source}: there is no column {wanted!r} for the {quantity}{guess(str(wanted), names)}; "
            f"it has: {listed(names)}"
        )
    dimensions = channel_of(quantity).dimensions
    unit = unit_in_name(exact[0], dimensions)
    if found := _MULTIPLIED.match(exact[0]):
        return _divided(Column(exact[0], unit_in_name(found["stem"], dimensions)), channel_of(quantity), found)
    stated = unit or unit_in_brackets(exact[0])
    if stated and stated.dimension not in dimensions and not unit_is_given:
        raise InputError(
            f"{source}: column {exact[0]!r} is in {stated.symbol}, which is no unit of the {quantity}; choose another "
            f"column, or give its unit with --unit {quantity}={channel_of(quantity).example.split()[0]}"
        )
    return Column(exact[0], unit)


def given_unit(quantity: str, spelling: str) -> Unit:
    """The unit with this spelling; InputError where there is none, or it is of another dimension."""
    unit = unit_of(str(spelling))
    channel = channel_of(quantity)
    if unit is None or unit.dimension not in channel.dimensions:
        raise InputError(f"unit {spelling!r} of the {quantity} is not known; use for example {channel.example}")
    return unit


def only_one(source: str, names: Sequence[str], quantity: str, fits: Sequence[Column]) -> Column:
    """The first column that fits; UnclearColumnsError where another one fits as well."""
    first = fits[0].name
    if others := [column.name for column in fits if column.name != first]:
        fault = f"both {first!r} and {others[0]!r} may be the {quantity}"
        is_current = quantity == CURRENT.name
        if is_current:
            fault += (
                " (if one charges and the other discharges, call them charge_current and discharge_current; those of "
                "parallel strings add up: write their sum)"
            )
        raise UnclearColumnsError(
            source, names, {quantity: fault}, {quantity: None if is_current else first}, [first, *dict.fromkeys(others)]
        )
    return fits[0]


def _best(source: str, names: Sequence[str], channel: Channel) -> Column | None:
    # beside `currentB`, `currentA` is that of a phase
    whole = [name for name in names if not (name.endswith("A") and f"{name[:-1]}B" in names)]
    ranked = [(rank, column) for name in whole for rank, column in _ranks(channel, name)]
    best = min((rank for rank, _ in ranked), default=_NEVER)
    if best >= _NEVER:
        return None
    fits = [column for rank, column in ranked if rank == best]
    if channel is TIME:
        fits = [column for column in fits if column.name != _TEMPERATURE] or fits
        fractions = [fraction[0] for column in fits if (fraction := fraction_column(names, column.name))]
        fits = [column for column in fits if column.name not in fractions]
        fits = [column for column in fits if not _CLOCK_OR_ID & set(letters(column.name))] or fits
        fits = [column for column in fits if _WHOLE_TIME & set(letters(column.name))] or fits
        if "date" in map(str.lower, names):  # beside it `Time` is a time of day, not to the fraction of a second
            fits = [column for column in fits if column.name.lower() != "time"] or fits
    if channel in (CURRENT, VOLTAGE) and not has_input_voltage(names):
        fits += [Column(name, None) for name in names if any(_is_way_back(column.name, name) for column in fits)]
    return fits[0] if channel.first_of_many else only_one(source, names, channel.name, fits)


def has_input_voltage(names: Sequence[str]) -> bool:
    """True where more than a current goes in: the names are of a converter, whose input is the battery."""
    return sum(bool(IN & set(letters(name))) for name in names) > 1


def _is_way_back(name: str, other: str) -> bool:
    """True for a current or voltage out beside one in, neither alone the battery's; a converter has both of them in."""
    words, beside = set(letters(name)), set(letters(other))
    return bool(words & IN and beside & OUT) and words - IN == beside - OUT


def _ranks(channel: Channel, name: str) -> Iterator[tuple[int, Column]]:
    """Ranks of the ways to read a name as this channel."""
    if found := _MULTIPLIED.match(name):
        yield from (
            (rank, _divided(one._replace(name=name), channel, found)) for rank, one in _ranks(channel, found["stem"])
        )
        return
    for stem, unit in split_unit(name):
        if channel is TEMPERATURE and unit is UNITS["deg"] and _TEMPERATURES & set(letters(stem)):
            unit = UNITS["degc"]  # `Temp1[Deg]`
        if unit is None or unit.dimension in channel.dimensions:
            yield _rank(channel, stem, unit), Column(name, unit)
    if channel is TIME and (bare := _NOTATION.sub("", name)) != name:
        yield _rank(channel, bare, None) + _NOTATED, Column(name, None)


#: Notation of a time after its name: `(h:min:s)`, `[hh:mm:ss.SSS]`, `(Hours in hh:mm:ss)`.
_NOTATION = re.compile(r"\s*[(\[]\s*(?:hours in )?h+:(?:m+|min):s+(?:\.[a-z0]+)?\s*[)\]]\s*$", re.IGNORECASE)
#: A name that says by what the numbers were multiplied: `Amps*100`, `current_x10`.
_MULTIPLIED = re.compile(r"^(?P<stem>.+?)(?:[\s_(\[]+[xX×]|\s*[*×])\s*(?P<factor>10+)\s*[)\]]?$")


def _divided(column: Column, channel: Channel, found: re.Match[str]) -> Column:
    """The column with its unit, or the channel's, divided by the factor in its name."""
    unit = column.unit or channel.default
    return column._replace(
        unit=Unit(f"{unit.symbol} / {found['factor']}", unit.dimension, unit.scale / int(found["factor"]))
    )


def _rank(channel: Channel, stem: str, unit: Unit | None) -> int:
    words = channel.split(_CHANNEL.sub("", stem))
    # a bare `t`, also a second one, is a time; a temperature called `T` must carry its unit
    if channel is TEMPERATURE and unit is None and re.fullmatch(r"T|t(?: \d+)?", stem):
        return _NEVER
    if unit is None and set(words) in _WITH_UNIT_ONLY:
        return _NEVER
    # `T1` and `TS1` are temperatures
    if channel is TIME and unit is None and re.fullmatch(r"[tT][sS]?\d+", stem):
        return _NEVER
    for rank, beside in zip(_BESIDE, channel.beside, strict=False):
        naming = [word for word in words if word not in beside] or ([] if unit else words[-1:])
        # `Battery [V]` is a voltage by its unit
        if frozenset(naming) in channel.words or (not naming and unit is not None and channel in _BY_UNIT):
            # a letter without a unit may be another quantity: v is a speed beside `voltage`
            bare_letter = unit is None and len("".join(naming)) == 1
            numbered = bare_letter and re.search(r"\d", stem) is not None  # U1 beside U_pack is that of a cell
            auxiliary = channel in BATTERY and _AUXILIARY.search(stem) is not None
            # a wall clock may be set while the log runs
            wall_clock = channel is TIME and any(word in stem.lower() for word in _WALL_CLOCK)
            of_channel = _CHANNEL.search(stem) is not None
            worse = _BARE_LETTER * bare_letter + _NUMBERED * numbered + _OF_CHANNEL * of_channel
            return rank + worse + _WALL_CLOCK_TIME * wall_clock + _OF_AUXILIARY * auxiliary
    # `motor_current` is a current, `current_speed` is not
    last = channel in BATTERY and channel is not TIME and words[-1:] == [channel.name]
    others = _OTHER_WORDS | _OTHER_DEVICES if channel is TEMPERATURE else _OTHER_WORDS
    return _LAST_WORD if last and not others & set(words) else _NEVER


def _nearest(names: Sequence[str], channel: Channel) -> str | None:
    """The column whose name begins like that of a channel or is misspelled, or the only one with its unit; or None."""
    units = {name: split_unit(name)[0][1] for name in names}
    likely = [name for name in names if not _OTHER_WORDS & set(channel.split(name))]
    if channel is TIME:  # `temp` is much like `tempo`
        likely = [name for name in likely if not _TEMPERATURES & set(channel.split(name))]
    likely = [name for name in likely if (unit := units[name]) is None or unit.dimension in channel.dimensions]
    by_letters = next((name for name in likely if channel.name[:3] in name.lower()), None)
    beside = channel.beside[-1]
    known = [
        word for words in channel.words for word in words if len(word) > _SHORTEST_MISSPELLED and word not in beside
    ]
    misspelled = (n for n in likely if any(difflib.get_close_matches(w, known, 1, _SIMILAR) for w in channel.split(n)))
    by_unit = [name for name in likely if units[name]]
    return by_letters or next(misspelled, None) or (by_unit[0] if len(by_unit) == 1 else None)


def _are_times(cells: Sequence[str]) -> bool:
    """True for cells that are dates with a time of day, or numbers, each larger than the one before."""
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        return all(has_date(cell) and has_time_of_day(cell) for cell in cells)
    return len(values) > 2 and all(later > before for before, later in pairwise(values))


def argument(text: str) -> str:
    """The text as it must be typed in a shell."""
    return f"'{text}'" if re.search(r"[^\w=.,+-]", text) else text


def guess(wanted: str, names: Sequence[str]) -> str:
    """A question that names the nearest column, or an empty text."""
    near = difflib.get_close_matches(wanted, names, n=1, cutoff=0.5)
    return f" (did you mean {near[0]!r}?)" if near else ""


def listed(names: Sequence[str], most: int = 30) -> str:
    """Names for a message, quoted and cut after `most`."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(repr(name) for name in names[:most]) + more


#: Names of the Battery Data Format (BDF, Battery Data Alliance, ontology 1.2), in which current > 0 charges.
BDF_SUFFIXES = (".bdf.csv", ".bdf.parquet")
# Log field -> preferred label, machine name, and for the wall clock ohmward's own name.
BDF_NAMES: Mapping[str, tuple[str, ...]] = {
    "time_s": ("Test Time / s", "test_time_second"),
    "voltage_V": ("Voltage / V", "voltage_volt"),
    "current_A": ("Current / A", "current_ampere"),
    "temperature_degC": ("Temperature T1 / degC", "temperature_t1_celsius"),
    "unix_time_s": ("Unix Time / s", "unix_time_second", "unix_time_s"),
}
_REQUIRED_OF_BDF = ("time_s", "voltage_V", "current_A")


def is_bdf(file: str) -> bool:
    """True where the suffix of a file's name says that it is BDF."""
    return file.lower().endswith(BDF_SUFFIXES)


def has_bdf_columns(names: Sequence[str]) -> bool:
    """True where the three required columns have their BDF names."""
    return all(set(BDF_NAMES[field]) & set(names) for field in _REQUIRED_OF_BDF)


def _require_bdf_columns(file: str, names: Sequence[str]) -> None:
    """Refuse a file that calls itself BDF and lacks required columns, which the error names."""
    known = set(map(_quantity, names))
    lacking = [BDF_NAMES[field][0] for field in _REQUIRED_OF_BDF if known.isdisjoint(map(_quantity, BDF_NAMES[field]))]
    if is_bdf(file) and lacking:
        raise InputError(
            f"{file}: BDF requires the columns {listed([BDF_NAMES[field][0] for field in _REQUIRED_OF_BDF])}; missing: "
            f"{listed(lacking)}; it has: {listed(names)}; rename the columns, or the file so that it is not called BDF"
        )


def _quantity(name: str) -> tuple[str, str]:
    """The name without its unit, and the dimension of that unit, "" for none."""
    stem, unit = split_unit(name)[0]
    return stem, unit.dimension if unit else ""
