"""Learn a battery from everyday logs: each log narrows the uncertainty of the file.

    before each log   P <- P + walk of capacity and resistances since the log before
    each part of it   x = most likely corrections and unknowns of the part, P = their posterior covariance
    after it          the corrections go into the file, their covariance into its knowledge

The posterior in the file is the prior of the next log.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, Knowledge, SeenLog, require_battery
from ohmward.battery.charge_count import RECORDING_GAP_S
from ohmward.battery.chemistries import Normal
from ohmward.battery.learning.charger_limit import full_at_charger_limit, limit_sentence
from ohmward.battery.learning.fold import (
    ageing_direction,
    fold,
    known,
    known_since,
    model_floor_V,
    not_identified_sentences,
    slip_direction,
    with_curve_of_file,
)
from ohmward.battery.learning.log_update import (
    LogEstimates,
    LogUpdate,
    combined,
    log_estimates,
    narrowed,
    what_narrowed,
)
from ohmward.battery.learning.parameters import parameters_of, prior_covariance
from ohmward.battery.learning.same_battery import (
    MISFITS,
    confirms,
    explained_worse,
    forgotten,
    is_label,
    moved_too_far,
    other_battery,
    other_label,
    too_small,
    unexplained,
)
from ohmward.battery.learning.samples import Samples, samples_of
from ohmward.battery.learning.solve import LOCATED_STD, PartProblem, Solution, count_error2, solve, with_capacity
from ohmward.battery.learning.start import (
    NewParts,
    full_at_start,
    given_at_start,
    likely_starts,
    new_parts,
    prior_of_age,
    soc_anchors,
)
from ohmward.battery.learning.voltage_model import VoltageModel, prior_of
from ohmward.battery.soc.anchor_rule import SocAnchor
from ohmward.battery.soc.anchors import Anchor, find_anchors
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.fit_check import misfits
from ohmward.battery.soc.registry import DEFAULT, make_estimator
from ohmward.battery.soc.sample import starts_of_logs
from ohmward.errors import InputError
from ohmward.logs.log import SECONDS_PER_HOUR, Log, LogSource, as_logs
from ohmward.optional import one_blas_thread

#: Called with the name of a log and the share of all logs that is done.
Progress = Callable[[str, float], None]

#: Random walk of the logarithms of capacity and resistances by use, in one full cycle: cells lose 0.02 to 0.3 % of
#: their capacity in one, and a trend over some ten cycles is followed.
_CYCLE_WALK = 0.005
#: Rounds in which a file that has learnt from no log finds how much its battery has aged since it was written.
_AGE_ROUNDS = 3
#: Steps of the search that compares modes of the posterior.
_FEW_STEPS = 3
#: Spacing of the rows that are used to compare them.
_COARSE = 10


class Learnt(NamedTuple):
    """The battery after all logs, and the update by each of them."""

    battery: Battery
    updates: tuple[LogUpdate, ...]


class _Part(NamedTuple):
    """Update by a part of a log: the battery after it, its solution and model, and the estimates from it alone."""

    battery: Battery
    solution: Solution
    model: VoltageModel
    own: LogEstimates


def learn(
    battery: Battery,
    logs: LogSource | Sequence[LogSource],
    *,
    initial_soc: float | Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> Learnt:
    """Update a battery by logs, one after the other: in order of their clocks where all have one, else as given.

    >>> learnt = ow.learn(ow.load_battery("battery.toml"), ["day.csv"])
    >>> [update.verdict for update in learnt.updates]
    ['learnt']
    >>> ow.save_battery(learnt.battery, "battery.toml")

    logs: a Log or several, or paths or DataFrames of them.
    initial_soc: state of charge at the start of every log, or by the names of the logs, where known.
    progress: called with the name of each log and the share of them that is done.

    Raises:
        InputError: `battery` is not a Battery; `initial_soc` names another log, or lies outside 0 to 1.
    """
    require_battery(battery)
    given = as_logs(logs)
    starts = starts_of_logs(initial_soc, [log.name for log in given])
    has_clock = all(log.begin_unix_s is not None for log in given)
    in_order = sorted(given, key=lambda log: log.begin_unix_s or 0.0) if has_clock else given
    updates = []
    for k, log in enumerate(in_order):
        if progress:
            progress(log.name, k / len(in_order))
        battery, update = learn_log(battery, log, starts.get(log.name))
        updates.append(update)
    return Learnt(battery, tuple(updates))


@one_blas_thread()
def learn_log(
    battery: Battery, log: Log, initial_soc: float | None = None, check_fit: bool = True
) -> tuple[Battery, LogUpdate]:
    """The battery after one log, and the update by it; the battery is unchanged where the log is set aside.

    check_fit: set aside a log that the file does not fit by the check of `ohmward soc`.
    """
    try:
        new = new_parts(battery, log)
    except InputError as refusal:
        return battery, _not_learnt(battery, log, "set aside", str(refusal))
    if not new.parts:
        return battery, _not_learnt(battery, log, "seen", "the battery has learnt from it before")
    first = new.parts[0]
    initial_soc = initial_soc if first.time_s[0] == log.time_s[0] else None
    try:
        today = battery if first.begin_unix_s is None else replace(battery, noise=battery.noise.on(first.begin_unix_s))
        ready = reduce(full_at_charger_limit, new.parts, today)
        anchors = tuple(anchor for part in new.parts for anchor in find_anchors(part, ready))
        cycles = 0.5 * sum(part.throughput_Ah() for part in new.parts) / ready.capacity_Ah
        before = aged(ready, hours_since_last(ready, first), cycles)
        given = given_at_start(ready, first, initial_soc)
        parts = _learn_parts(before, new.parts, anchors, given)
    except (InputError, np.linalg.LinAlgError) as refusal:
        if new.mostly_seen:
            return battery, _not_learnt(battery, log, "seen", f"except for a part without information: {refusal}")
        return battery, _not_learnt(battery, log, "set aside", str(refusal))
    update = _update(battery, ready, log, new, parts, anchors)
    contradiction = _contradiction(before, log, update)
    if not contradiction and check_fit:
        contradiction = _misfit_of_file(battery, new.parts, initial_soc)
    if contradiction:
        return battery, _not_learnt(battery, log, "set aside", contradiction)
    to_its_end = log.time_s[-1] - parts[-1].model.samples.time_s[-1] <= RECORDING_GAP_S
    seen = SeenLog(
        name=log.name,
        fingerprint=new.fingerprint,
        start_unix_s=log.begin_unix_s,
        end_unix_s=log.end_unix_s,
        hours=update.hours,
        summary=update.reason,
        anchors=sum(anchor.kind != "rest" for anchor in anchors) + (initial_soc is not None),
        end_soc=update.soc_end.mean if to_its_end else None,
        end_soc_std=update.soc_end.std if to_its_end else None,
        end_current_A=float(np.nan_to_num(log.current_A[-1])),
    )
    return _remember(ready, parts[-1].battery, seen), update


def _remember(before: Battery, after: Battery, log: SeenLog) -> Battery:
    """The battery with the log among those that it has learnt from."""
    assert after.knowledge is not None
    logs = (*before.learnt_logs, log)
    last_unix_s = max((seen.end_unix_s for seen in logs if seen.end_unix_s is not None), default=None)
    learnt = known_since(replace(after, knowledge=replace(after.knowledge, logs=logs)), last_unix_s)
    return replace(learnt, not_identified=not_identified_sentences(learnt))


def _contradiction(battery: Battery, log: Log, update: LogUpdate) -> str:
    """Contradiction of a log with the battery, as it has aged until then, or with itself; "" for none."""
    before = known(battery)
    if larger := too_small(update.capacity_Ah, update.soc_max - update.soc_min):
        return larger
    if is_label(battery):
        return unexplained(update) or other_label(before, update) or unexplained(update, MISFITS)
    if confirms(before, update):
        return ""
    _, alone = learn_log(forgotten(battery), log, check_fit=False)
    if alone.verdict != "learnt":
        return alone.reason
    seconds, correlation_s = SECONDS_PER_HOUR * update.hours, battery.noise.correlation_s
    worse = explained_worse(seconds, correlation_s, update.residual_rms_V, alone.residual_rms_V)
    return other_battery(before, alone, worse) or moved_too_far(before, update) or unexplained(update)


def _misfit_of_file(battery: Battery, parts: Sequence[Log], initial_soc: float | None) -> str:
    """Misfit of the file to a log, or an exchange along it, by the checks of `ohmward soc`; "" for none."""
    estimator = make_estimator(DEFAULT, battery)
    for part in parts:
        run = SocEstimator(estimator, initial_soc if part is parts[0] else None).run(part)
        if found := run.exchanges or misfits(battery, part, run.settings, run.estimates, in_itself=False):
            return found[0].text
    return ""


def aged(battery: Battery, hours: float, cycles: float) -> Battery:
    """The battery aged by these hours and full cycles, in which capacity and resistances walk."""
    if battery.knowledge is None:
        return battery
    p, noise, span_s = parameters_of(battery), battery.noise, SECONDS_PER_HOUR * hours
    covariance, direction = prior_covariance(battery), ageing_direction(battery, p)
    slipped = noise.ocv_slip_std * slip_direction(battery, p)
    capacity_variance: Any = noise.capacity_walk_variance(span_s) + _CYCLE_WALK**2 * cycles
    covariance += capacity_variance * (np.outer(direction, direction) + np.outer(slipped, slipped))
    resistance_variance: Any = noise.resistance_walk_variance(span_s) + _CYCLE_WALK**2 * cycles
    resistances = p.places("ohmic", "pair")
    covariance[np.ix_(resistances, resistances)] += resistance_variance
    covariance[p.group("offset"), p.group("offset")] += battery.sensor.offset_walk_variance(span_s)
    of_aged = Knowledge.of(p.names, covariance, battery.learnt_logs, battery.curve_seen_from_soc)
    return replace(battery, knowledge=of_aged)


def hours_since_last(battery: Battery, log: Log) -> float:
    """Hours between the last log that the battery has seen and this one; 0 without a clock."""
    start = log.begin_unix_s
    ends = [seen.end_unix_s for seen in battery.learnt_logs if seen.end_unix_s]
    return max(start - max(ends), 0.0) / SECONDS_PER_HOUR if ends and start is not None else 0.0


def _learn_parts(
    battery: Battery, logs: Sequence[Log], anchors: Sequence[Anchor], given: tuple[SocAnchor, ...]
) -> list[_Part]:
    """Updates by the parts of a log, one after the other; raises InputError where there is nothing to learn from.

    given: state of charge at the first sample, where it is known.
    """
    parts: list[_Part] = []
    for k, samples in enumerate(chain.from_iterable(samples_of(log, battery) for log in logs)):
        if not samples.rows.size:
            continue
        now = parts[-1].battery if parts else battery
        at_start = (given if k == 0 else ()) or full_at_start(now, samples)
        parts.append(_learn_part(now, samples, (*at_start, *soc_anchors(anchors, samples))))
    if not parts:
        raise InputError("no stretch of it has two samples with a credible current and voltage; check the columns")
    return parts


def _learn_part(battery: Battery, samples: Samples, anchors: tuple[SocAnchor, ...]) -> _Part:
    """Update by one part."""
    model = VoltageModel(battery, samples, samples.rows)
    of_file = prior_of(model, model_floor_V(battery))
    problem = PartProblem(model, of_file, anchors)
    found = solve(problem, _best_start(problem))
    for _ in range(_AGE_ROUNDS if battery.knowledge is None else 0):
        problem = replace(problem, prior=prior_of_age(model, of_file, found.x))
        found = solve(problem, found.x)
    located = anchors or found.ends_std.min() < LOCATED_STD
    error2 = count_error2(problem, found)
    found = with_capacity(problem, found, error2)
    K = model.parameters.size
    theta, covariance = found.x[:K], found.covariance[:K, :K]
    lowest_soc = float(found.charge.soc.min())
    if not located:
        before = problem.prior.cov[:K, :K]
        theta, covariance = with_curve_of_file(model.parameters, theta, covariance, before)
        lowest_soc = 1.0
    after = fold(battery, theta, covariance, lowest_soc, error2)
    return _Part(after, found, model, log_estimates(model, problem.prior, found, after))


def _best_start(problem: PartProblem) -> np.ndarray:
    """The start of the search that leads to the highest mode."""
    candidates = likely_starts(problem.model, problem.prior.mean, problem.anchors)
    if len(candidates) == 1:
        return candidates[0]
    tried = [solve(problem.coarse(x, _COARSE), x, _FEW_STEPS) for x in candidates]
    return min(tried, key=lambda solution: solution.cost).x


def _update(
    file: Battery, before: Battery, log: Log, new: NewParts, parts: Sequence[_Part], anchors: tuple[Anchor, ...]
) -> LogUpdate:
    """Update by the log.

    file: the battery as its file has it; before: the same that is full where the charger of the log stops.
    """
    after = parts[-1].battery
    socs = [part.solution.charge.soc for part in parts]
    residual_V = np.concatenate([part.solution.residual_V for part in parts])
    rows = [part.model.rows.size for part in parts]
    deepest = min(parts, key=lambda part: part.own.lowest_soc)
    found = known(after)
    information = narrowed(parameters_of(after), prior_covariance(before), prior_covariance(after))
    return LogUpdate(
        log=log.name,
        verdict="learnt",
        reason=limit_sentence(file, before) + what_narrowed(information),
        hours=new.hours,
        soc_min=float(min(soc.min() for soc in socs)),
        soc_max=float(max(soc.max() for soc in socs)),
        capacity_Ah=found.capacity_Ah,
        resistance_ohm=found.resistance_ohm,
        offset_A=found.offset_A,
        information=information,
        residual_rms_V=float(np.sqrt(np.mean(residual_V**2))),
        misfit=float(np.average([part.solution.misfit for part in parts], weights=rows)),
        soc_start=_soc_at(parts[0], 0),
        soc_end=_soc_at(parts[-1], parts[-1].model.samples.time_s.size - 1),
        own_capacity_Ah=combined([part.own.capacity_Ah for part in parts]),
        own_resistance_ohm=combined([part.own.resistance_ohm for part in parts]),
        given_Ah=deepest.own.given_Ah,
        anchors=anchors,
        left_out=new.left_out,
    )


def _soc_at(part: _Part, sample: int) -> Normal:
    """State of charge at a sample of a part."""
    charge = part.solution.charge
    columns = charge.soc_columns(np.array([sample]))[0]
    return Normal(float(charge.soc[sample]), float(np.sqrt(columns @ part.solution.covariance @ columns)))


def _not_learnt(battery: Battery, log: Log, verdict: str, reason: str) -> LogUpdate:
    """The update by a log that was set aside or seen before."""
    found, hours = known(battery), log.duration_s / SECONDS_PER_HOUR
    return LogUpdate(log.name, verdict, reason, hours, found.capacity_Ah, found.resistance_ohm, found.offset_A)
