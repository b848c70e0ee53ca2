"""Fill the two tables of README.md and of the paper, and that of the range, from the benchmarks.

`python docs/fill_readme.py`: five rows each in README.md and the paper, in words that a user knows; the rows are named
here, the figures come from `benchmarks/accuracy.md`, `benchmarks/drive_to_empty.md`, `benchmarks/speed.md` and
`benchmarks/firmware.md`. Among the rows are one in which plain coulomb counting is better and one in which a peer is
nearly as fast.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from marked_block import replaced

ROOT = Path(__file__).parents[1]
README, PAPER, ENERGY = ROOT / "README.md", ROOT / "paper" / "paper.md", ROOT / "docs" / "energy.md"
BENCHMARKS = ROOT / "benchmarks"
DATA, METHOD, START, QUANTITY = "data", "method", "start", "quantity"
RMSE, COVERAGE, VALUE = "RMSE", "coverage of 95 %", "value"
OVERVIEW = "## One log, in short"


class ChargeRow(NamedTuple):
    """A row about the state of charge: its words, and the recording and start that it is of."""

    words: str
    data: str
    start: str


CHARGE = (
    ChargeRow(
        "Charge, LFP cell on a drive, current sensor 50 mA off", "A123 LFP dynamic, 25 degC", "right, +50 mA offset"
    ),
    ChargeRow(
        "Charge, NCA cell on a drive, started 20 points low, after an hour",
        "Panasonic NCA Cycle_1, 25 degC",
        "20 points low, after 60 min",
    ),
    ChargeRow(
        "Charge, lead-acid battery of a solar home, from the right start",
        "BBOXX VRLA telemetry, third discharge",
        "right",
    ),
)
SLIP = ("Robotino, gray floor, runs not learnt from", "UKF on learnt floors, encoders + currents")
SLIP_ERROR, SLIP_COVERAGE = "mean slip of a run, mean absolute error", "runs in the 95 % band"
RANGE_COVERAGE = "truth within P10-P90 [%]"
RANGE_ERROR, COUNTED_RANGE = (
    "median error of P50, from half charge on [%]",
    "the same by counting and the mean consumption",
)
RANGE_ASKED = {
    "not known": "",
    "known": ", course known",
    "not known, after a day to the cut-off": ", after a day to the cut-off",
    "known, after a day to the cut-off": ", course known, after a day to the cut-off",
}
LIVE = "`update()`, the default, a sum of three extended filters, machine code"
PEERS = (
    ("FilterPy", "as documented", "UKF, 3 states"),
    ("FilterPy", "as documented", "AUKF, 7 states"),
    ("CasADi", "SX, mapaccum, its C code by", "EKF, 3 states"),
)
ON_CHIP = "textbook-ukf, every 1 s, curve within 4 mV"


def main() -> None:
    """Rewrite the blocks between the markers; a block whose benchmark is absent is empty."""
    for path in (README, PAPER, ENERGY):
        path.write_text(filled(path), encoding="utf-8")


def filled(path: Path) -> str:
    """The text of this page with its tables made anew."""
    text = path.read_text(encoding="utf-8")
    if path == ENERGY:
        return replaced(text, "range", range_table(page("drive_to_empty.md")))
    with_accuracy = replaced(text, "accuracy", accuracy_table(page("accuracy.md"), page("drive_to_empty.md")))
    return replaced(with_accuracy, "speed", speed_table(page("speed.md"), page("firmware.md")))


def page(name: str) -> str:
    """The text of a benchmark's page, empty where there is none."""
    path = BENCHMARKS / name
    return path.read_text(encoding="utf-8") if path.exists() else ""


def accuracy_table(text: str, to_empty: str) -> list[str]:
    """Rows about charge, slip and range; none without a benchmark."""
    rows = list(read_rows(text, DATA))
    if not rows:
        return []
    charge = {(row[DATA], row[METHOD], row[START]): row for row in rows if START in row}
    motion = {(row[DATA], row[METHOD], row[QUANTITY]): row[VALUE] for row in rows if QUANTITY in row}
    lines = ["| what | error | by counting alone | truth in the band |", "|---|---|---|---|"]
    for words, data, start in CHARGE:
        ours, counted = charge[data, "default", start], charge[data, "coulomb", start]
        lines.append(f"| {words} | {ours[RMSE]} points | {counted[RMSE]} points | {ours[COVERAGE]} |")
    slip, coverage = float(motion[*SLIP, SLIP_ERROR]), motion[*SLIP, SLIP_COVERAGE].rstrip("%")
    what = "Slip ratio of an omni-directional robot on a slippery floor, mean of a run"
    lines.append(f"| {what} | {100 * slip:.1f} points | | {coverage} % |")
    if found := range_figures(to_empty):
        lines.append(
            f"| Range of simulated robots driven to empty, from half charge on, median | {found[RANGE_ERROR]} % | "
            f"{found[COUNTED_RANGE]} % | {found[RANGE_COVERAGE]} % between P10 and P90 (80 is right) |"
        )
    return lines


def range_table(to_empty: str) -> list[str]:
    """Errors and coverage of the range; none without the benchmark."""
    found = range_figures(to_empty)
    if not found:
        return []
    lines = ["| ground ahead | median error of P50 | truth within P10-P90 | below P10 |", "|---|---|---|---|"]
    for words, asked in RANGE_ASKED.items():
        error = found[f"median error of P50{asked}, from half charge on [%]"]
        inside, below = found[f"truth within P10-P90{asked} [%]"], found[f"truth below P10{asked} [%]"]
        lines.append(f"| {words} | {error} % | {inside} % | {below} % |")
    best = found["the same at best over unknown ground"]
    return [*lines, f"| not known, but charge and robot are: the best possible | {best} % | | |"]


def range_figures(to_empty: str) -> dict[str, str]:
    """Values over all drives to the empty battery, by quantity."""
    return {row["quantity"]: row["value"] for row in read_rows(to_empty, "drives") if row["drives"].startswith("all ")}


def speed_table(speed: str, firmware: str) -> list[str]:
    """Rows about live samples, whole logs and a microcontroller; none without the benchmarks."""
    if not (speed and firmware):
        return []
    goals = {row["what"]: row["measured"] for row in read_rows(speed, "what") if "measured" in row}
    overview = {
        (row["who"], row["how"]): row for row in read_rows(speed.partition(OVERVIEW)[2].partition("\n## ")[0], "who")
    }
    lines = [
        "| what | ohmward | beside |",
        "|---|---|---|",
        f"| One live sample through `update()`, the default filter | {goals[LIVE]} | |",
    ]
    for who, how, kind in PEERS:
        ours = overview["ohmward", "machine code"][kind]
        theirs = next(row for (name, way), row in overview.items() if name == who and way.startswith(how))[kind]
        by = "FilterPy" if who == "FilterPy" else "CasADi's generated C"
        lines.append(f"| A log, per sample: {kind} | {ours.partition(' (')[0]} | {by} {theirs} |")
    chip = next(row for row in read_rows(firmware, "code [bytes]") if list(row.values())[:2] == [ON_CHIP, "-Os"])
    size = f"{chip['code [bytes]']} bytes of code, {chip['tables [bytes]']} of tables, {chip['state [bytes]']} of state"
    lines.append(f"| UKF, 3 states, in C on an emulated Cortex-M4F | {chip['instructions']} instructions | {size} |")
    return lines


def read_rows(text: str, first: str) -> Iterator[dict[str, str]]:
    """The rows of the tables that have a column of this name, by the names in their headers."""
    header: list[str] = []
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if not line.startswith("|"):
            header = []
        elif first in cells:
            header = [name or str(i) for i, name in enumerate(cells)]
        elif header and not set(line) <= set("|-: "):
            yield dict(zip(header, cells, strict=True))


if __name__ == "__main__":
    main()
