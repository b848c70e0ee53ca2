"""Tables and figures with results of [P], in its order."""

from __future__ import annotations

from functools import partial

from ohmward_lab.reproduce import paper_identification, paper_soc
from ohmward_lab.reproduce.row import Item

ITEMS = (
    Item(("3", "2.2"), "Pulse test, the 75 % rule, C_s from the first 500 ms", paper_identification.pulse_test),
    Item(("5", "6"), "Relaxations with one and with two time constants", paper_identification.relaxations),
    Item(("7",), "The circuit before and after the nonlinear fit", paper_identification.fit),
    Item(("8",), "Open-circuit voltage", paper_identification.open_circuit),
    Item(("10", "11"), "Sealed lead-acid, 100 to 60 %", partial(paper_soc.discharge, "lead-acid")),
    Item(("12",), "A wrong start taken as given", paper_soc.wrong_start),
    Item(("13",), "LFP, 100 to 20 %", partial(paper_soc.discharge, "lfp")),
    Item(("section 5",), "The methods compared, with the hybrid", paper_soc.comparison),
)
