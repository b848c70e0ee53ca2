"""Number of RC pairs by the evidence of the records, and the slowest time constant that they can show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.circuit_design import Rates
from ohmward.battery.identification.circuit_fit import CircuitFit, fit_circuit
from ohmward.battery.identification.circuit_solve import CircuitProblem
from ohmward.battery.identification.record import Record
from ohmward.battery.identification.segments import find_rests
from ohmward.logs.log import Note

#: A process has gone to 1 - e^-2 = 86 % in a rest of two time constants: its own end is then known.
_REST_SHARE = 0.5
#: Under a load the open-circuit voltage moves as well; a process that takes longer than a tenth of the record is told
#: from an error of the OCV curve by nothing.
_RECORD_SHARE = 0.1
#: One pair more needs strong evidence: 2 ln(Bayes factor) > 6 (Kass and Raftery, J. Am. Stat. Assoc. 1995).
_STRONG_EVIDENCE = 6.0
#: The fit with two pairs comes first, at this share of the time; the others start from its time constants.
_FIRST, _SECOND = 0.6, 0.9
#: Time constants of a further pair, over those that two pairs have: between them, and faster than both.
_FASTER = 0.25


class PairChoice(NamedTuple):
    """The circuit with the number of pairs that the records support, and why."""

    fit: CircuitFit
    note: Note


def longest_rest_s(records: Sequence[Record]) -> float:
    """Duration [s] of the longest rest after a current, 0 without any."""
    return max((rest.duration_s for r in records for rest in find_rests(r.phases, 0.0)), default=0.0)


def longest_tau_s(records: Sequence[Record]) -> float:
    """Slowest time constant [s] that the records can show: half the longest rest, or a tenth of the longest record."""
    return max(_REST_SHARE * longest_rest_s(records), _RECORD_SHARE * max(r.log.duration_s for r in records))


def choose_pairs(problem: CircuitProblem, progress: Callable[[float], None] | None = None) -> PairChoice:
    """The circuit with one, two or three RC pairs, the fewest that no strong evidence speaks against.

    The evidence of a fit is its score, minus twice the log of the marginal likelihood.
    """
    report = progress or (lambda share: None)
    two = fit_circuit(problem, 2, lambda share: report(_FIRST * share))
    fits = {2: two, 3: fit_circuit(problem, 3, lambda s: report(_FIRST + (_SECOND - _FIRST) * s), _with_one_more(two))}
    if not _speaks_for(fits[3], two):
        fits[1] = fit_circuit(problem, 1, lambda s: report(_SECOND + (1 - _SECOND) * s), _with_one_less(two))
    chosen = 3 if 1 not in fits else 2 if _speaks_for(two, fits[1]) else 1
    report(1.0)
    return PairChoice(fits[chosen], _note(chosen, fits))


def _speaks_for(more: CircuitFit, fewer: CircuitFit) -> bool:
    """True where the evidence for the circuit with more pairs is strong."""
    return fewer.solution.score - more.solution.score > _STRONG_EVIDENCE


def _with_one_more(two: CircuitFit) -> tuple[Rates, ...]:
    """Rates of three pairs to start from: the two that were found, and one between, below or above them."""
    rates = two.solution.rates
    fast_s, slow_s = rates.tau_s
    between_s = float(np.sqrt(fast_s * slow_s))
    candidates = [(fast_s, between_s, slow_s), (_FASTER * fast_s, fast_s, slow_s), (fast_s, slow_s, slow_s / _FASTER)]
    return tuple(rates._replace(tau_s=tau_s) for tau_s in candidates)


def _with_one_less(two: CircuitFit) -> tuple[Rates, ...]:
    """Rates of one pair to start from: either of the two that were found, or one between."""
    rates = two.solution.rates
    fast_s, slow_s = rates.tau_s
    return tuple(rates._replace(tau_s=(tau_s,)) for tau_s in (fast_s, float(np.sqrt(fast_s * slow_s)), slow_s))


def _note(chosen: int, fits: dict[int, CircuitFit]) -> Note:
    """Sentence on the choice and on the evidence for it."""
    best = fits[chosen].solution.score
    others = ", ".join(
        f"{fit.solution.score - best:+.0f} with {pairs}" for pairs, fit in sorted(fits.items()) if pairs != chosen
    )
    return Note(
        f"RC pairs: {chosen} chosen by evidence "
        f"(-2 ln of it: {others}; a pair more must lower it by {_STRONG_EVIDENCE:g})"
    )
