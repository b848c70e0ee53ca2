"""What `soc` and `compare` share: their options, and a battery, a log and a truth made ready."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, NamedTuple

from ohmward.cli.parser import add_log_options, number, positive, share
from ohmward.cli.progress import Report, counting
from ohmward.cli.reading import read
from ohmward.errors import InputError

if TYPE_CHECKING:
    from ohmward.battery.battery import Battery
    from ohmward.battery.soc.estimator import SocRun
    from ohmward.cli.truth import SocTruth
    from ohmward.logs import Log


UNKNOWN = "unknown"


#: The battery file knows the range of the tests; a log may leave it a little, not be somewhere else.
_OTHER_BATTERY = 0.2
_BEYOND_TESTS = 0.02


class SocTask(NamedTuple):
    """One log to estimate: the battery it is of, and the truth if there is one."""

    battery: Battery
    log: Log
    truth: SocTruth | None

    @property
    def notes(self) -> list[str]:
        """What was assumed while reading."""
        truth = [f"info: {self.truth.note}"] if self.truth else []
        return [str(note) for note in self.log.notes] + truth


def add_task_options(parser: argparse.ArgumentParser) -> None:
    """The log, the battery, the start and the truth."""
    parser.add_argument("log", metavar="LOG", help="a CSV, Parquet or BDF file")
    parser.add_argument(
        "--battery", required=True, metavar="FILE.toml", help="battery file, made by `ohmward identify`"
    )
    group = parser.add_argument_group("estimation")
    group.add_argument(
        "--initial-soc", type=share, metavar="S", help="state of charge at the start, 0 to 1; default: from the voltage"
    )
    group.add_argument(
        "--initial-soc-std", type=positive, default=0.03, metavar="S", help="how sure that is (default %(default)s)"
    )
    group.add_argument(
        "--rest-current",
        type=rest_current,
        metavar="A",
        help="true current of a rest: 0 in a laboratory, minus the idle draw on a robot, 'unknown' teaches the filter "
        "nothing; default: the battery file's",
    )
    group.add_argument(
        "--truth",
        metavar="COLUMN",
        help="reference in the log: a share, percent or Ah counter; 'a - b' for a counter of each direction",
    )
    group.add_argument(
        "--truth-start", type=share, metavar="S", help="state of charge at which an Ah counter starts, 0 to 1"
    )
    add_log_options(parser)


def make_task(args: argparse.Namespace, report: Report | None = None) -> SocTask:
    """Read what the options of `add_task_options` name."""
    from ohmward.battery.file import load_battery
    from ohmward.cli.truth import read_truth

    battery = load_battery(args.battery)
    log = within_range(read(args.log, args, None if args.truth else (), report), battery)
    start = args.initial_soc if args.truth_start is None else args.truth_start
    return SocTask(battery, log, read_truth(log, args.truth, battery.capacity_Ah, start) if args.truth else None)


def within_range(log: Log, battery: Battery) -> Log:
    """The log, with a warning where its voltage leaves the range of the battery's tests by more than 2 %.

    Raises:
        InputError: the usual voltage is more than 20 % outside: another battery, or another unit.
    """
    import numpy as np

    from ohmward.logs import Note

    low_V, high_V = battery.voltage_min_V, battery.voltage_max_V
    usual_V = float(np.nanmedian(log.voltage_V))
    if not (1 - _OTHER_BATTERY) * low_V <= usual_V <= (1 + _OTHER_BATTERY) * high_V:
        raise InputError(
            f"{log.name}: its voltage is usually {usual_V:.4g} V, but battery {battery.name!r} was seen between "
            f"{low_V:g} and {high_V:g} V; is it a log of another battery, of one of its cells, or in another unit "
            "(--unit voltage=mV)?"
        )
    outside = (log.voltage_V < (1 - _BEYOND_TESTS) * low_V) | (log.voltage_V > (1 + _BEYOND_TESTS) * high_V)
    if not outside.any():
        return log
    text = f"{outside.mean():.2%} of the voltages lie outside the battery's tests, {low_V:g} to {high_V:g} V"
    return log.with_notes(Note(text, "warning"))


def estimate(task: SocTask, name: str, args: argparse.Namespace, report: Report | None = None) -> SocRun:
    """Run the estimator called `name` over the log."""
    from ohmward.battery.soc.estimator import SocEstimator
    from ohmward.battery.soc.registry import EstimatorSettings, make_estimator

    rest = task.battery.idle_current_A if args.rest_current is None else args.rest_current
    settings = EstimatorSettings(idle_current_A=None if rest == UNKNOWN else rest)
    estimator = make_estimator(name, task.battery, settings)
    return SocEstimator(estimator, args.initial_soc, args.initial_soc_std).run(task.log, counting(report, name))


def rest_current(text: str) -> float | str:
    """A current [A], or the word that says that it is not known."""
    return UNKNOWN if text == UNKNOWN else number(text)
