"""Parts of the page of `learning.py`: what each compares, before and after a file has learnt."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import learning_gym as gym
import learning_measured as measured
import unequal_cells
from figure import Figure
from lives_cells import CELLS
from measured_lives import TUE_SPLITS

#: Cells on which the order of logs and packs are tried: of LFP and of NMC. A pack of another one takes an hour and more
#: to simulate.
FEW = 2


class Part(NamedTuple):
    """Figures of one battery.

    name: chosen by its words; section: of the page.
    base, learn: figures without `learn` and with it.
    kept_out: settings were never chosen on this cell.
    """

    name: str
    section: str
    base: Callable[[], Iterator[Figure]] | None
    learn: Callable[[], Iterator[Figure]]
    kept_out: bool = False


def parts() -> list[Part]:
    """Every part of the page."""
    return [*_gym(), *_measured(), *_packs()]


def _gym() -> Iterator[Part]:
    quick = [cell for cell in CELLS if not cell.slow]
    for words, base, learnt in (
        ("week", gym.before_the_week, gym.week),
        ("aged", gym.before_the_cycles, gym.aged),
        ("same", None, gym.same),
    ):
        for cell in quick[:FEW] if words == "same" else quick:
            name = f"{words} {cell.chemistry} {cell.name}"
            yield Part(name, words, base and partial(base, cell), partial(learnt, cell), cell.kept_out)


def _measured() -> Iterator[Part]:
    for k, (cell, *_) in enumerate(TUE_SPLITS):
        yield Part(f"tue {cell} {k}", "tue", partial(measured.before_tue, k), partial(measured.tue, k))
    for name in measured.splits():
        yield Part(f"other {name}", "other", partial(measured.before_split, name), partial(measured.split, name))
    yield Part("bboxx", "bboxx", measured.before_bboxx, measured.bboxx)
    for name in measured.NASA:
        yield Part(f"nasa {name}", "nasa", partial(measured.before_nasa, name), partial(measured.nasa, name))
    yield Part("i3", "i3", measured.before_i3, measured.i3)


def _packs() -> Iterator[Part]:
    for cell in [cell for cell in CELLS if not cell.slow][:FEW]:
        yield Part(f"pack {cell.chemistry} {cell.name}", "pack", None, partial(unequal_cells.rows, cell), cell.kept_out)
    yield Part("pack of 28 cells", "pack", None, unequal_cells.many_cells)
