"""Sentences of a battery file on what its label leaves open, as far as no log has told it since."""

from __future__ import annotations

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import chemistry
from ohmward.battery.learning.known import known

#: How the sentences of a label begin; those of a test stay as they are.
_OF_A_LABEL = ("everything", "capacity: ", "resistances: ", "open-circuit voltage: ")
#: A curve that is seen down to this SoC is seen to its end.
_SEEN_TO_THE_END = 0.02


def untaught_sentences(battery: Battery) -> tuple[str, ...]:
    """The sentences on what is not known of the battery, those of its label brought up to what it has learnt."""
    others = tuple(text for text in battery.not_identified if not text.startswith(_OF_A_LABEL))
    if battery.knowledge is None or not any(text.startswith(_OF_A_LABEL[0]) for text in battery.not_identified):
        return battery.not_identified
    found, seen_soc = known(battery), battery.knowledge.seen_from_soc
    capacity = found.capacity_Ah.std / found.capacity_Ah.mean
    resistance = found.resistance_ohm.std / found.resistance_ohm.mean
    kind = f"cells of {chemistry(battery.chemistry).title}" if battery.chemistry else "batteries"
    sentences = [
        f"everything that no log has shown: start values that {kind} have in common",
        f"capacity: learnt within {capacity:.1%} (1 sigma) from {found.logs} log{'s' * (found.logs != 1)}",
        f"resistances: learnt within {resistance:.0%} (1 sigma)",
    ]
    if seen_soc > _SEEN_TO_THE_END:
        sentences.append(f"open-circuit voltage: no log went below {seen_soc:.0%} of charge")
    return (*sentences, *others)
