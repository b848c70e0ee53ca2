"""Fill the tables of README.md from the benchmarks: `python docs/fill_readme.py`.

The excerpts follow a rule, so that nobody picks what looks good. Charge: of every data set the estimator and the starts
for which the benchmark sets a goal, met or missed, beside coulomb counting from the same start; left out are twins, the
opposite sign of an offset and other temperatures. Motion: of every robot or plant the first figure for which the
benchmark sets a goal, and every goal that was missed. Speed: the table of all packages on one log, and of the
microcontroller the smallest build of a few filters from small to large.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
README, ACCURACY = ROOT / "README.md", ROOT / "benchmarks" / "accuracy.md"
SPEED, FIRMWARE = ROOT / "benchmarks" / "speed.md", ROOT / "benchmarks" / "firmware.md"
SPEED_BEGIN = "<!-- speed: written by docs/fill_readme.py from benchmarks/speed.md and benchmarks/firmware.md -->\n"
SPEED_END = "<!-- /speed -->"
OVERVIEW = "## One log, in short"
ON_BOARD = (
    "textbook-ekf, every 1 s",
    "textbook-ukf, every 1 s, curve within 4 mV",
    "textbook-joint, loops",
    "RLMA slip-controller",
    "ekf, every 1 s",
    "RLMA speed, ekf",
)
BEGIN = "<!-- accuracy: written by docs/fill_readme.py from benchmarks/accuracy.md -->\n"
END = "<!-- /accuracy -->"
TWINS = ("-50 mA", "declared currentless", ", 5 degC", ", 45 degC")
DATA, METHOD, START, RMSE, COVERAGE, GOAL = "data", "method", "start", "RMSE", "coverage of 95 %", "to reach"
QUANTITY, VALUE, MISSED = "quantity", "value", "**missed**"


def main() -> None:
    """Rewrite the block between the markers; without a benchmark it is empty."""
    README.write_text(filled(README.read_text(encoding="utf-8")), encoding="utf-8")


def filled(readme: str) -> str:
    """The text of the README with its blocks made anew."""
    rows = list(read_rows(_text(ACCURACY)))
    charge = [row for row in rows if START in row]
    motion = [row for row in rows if QUANTITY in row]
    speed = [*overview(_text(SPEED)), *on_board(_text(FIRMWARE))]
    return _block(
        _block(readme, SPEED_BEGIN, SPEED_END, speed), BEGIN, END, [*excerpt(charge), *motion_excerpt(motion)]
    )


def _text(page: Path) -> str:
    return page.read_text(encoding="utf-8") if page.exists() else ""


def _block(text: str, begin: str, end: str, lines: list[str]) -> str:
    """The text with these lines between two markers."""
    before, rest = text.split(begin)
    _, after = rest.split(end)
    return before + begin + "\n".join([*lines, end]) + after


def overview(page: str) -> list[str]:
    """The table of all packages on one log, none where there is no page."""
    _, found, rest = page.partition(OVERVIEW)
    return [*rest.partition("\n## ")[0].strip().splitlines(), ""] if found else []


def on_board(page: str) -> list[str]:
    """What a few filters take on a microcontroller, none where there is no page."""
    cells = [_cells(line) for line in page.splitlines() if line.startswith("|")]
    if not cells:
        return []
    header, _, *rows = cells
    smallest = {row[0]: dict(zip(header, row, strict=True)) for row in rows if row[1] == "-Os"}
    columns = ("code [bytes]", "tables [bytes]", "state [bytes]", "instructions", "time [us]")
    table = [f"| {' | '.join((name, *(smallest[name][c] for c in columns)))} |" for name in ON_BOARD]
    return [
        "Exported to C, on an emulated Cortex-M4F; time of a step at 100 MHz, with flash from fast to slow:",
        "",
        f"| {' | '.join(('filter', *columns))} |",
        "|---|---|---|---|---|---|",
        *table,
        "",
    ]


def read_rows(page: str) -> Iterator[dict[str, str]]:
    """The rows of the benchmark's tables, by the names in their headers."""
    header: list[str] = []
    for line in page.splitlines():
        cells = _cells(line)
        if not line.startswith("|") or set(line) <= set("|-: "):
            continue
        if DATA in cells:
            header = cells
        else:
            yield dict(zip(header, cells, strict=True))


def _cells(line: str) -> list[str]:
    """The cells of a row of a table."""
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def excerpt(rows: list[dict[str, str]]) -> list[str]:
    """The lines about charge, none where there are no rows."""
    if not rows:
        return []
    counted = {(row[DATA], row[START]): row[RMSE] for row in rows if row[METHOD] == "coulomb"}
    lines = [
        "Root mean square error of the state of charge in points of percent, on measured data:",
        "",
        "| recording | start | coulomb counting | ohmward | truth in its 95 % band |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        key = row[DATA], row[START]
        if key in counted and row[GOAL] and not any(twin in f"{row[DATA]}, {row[START]}" for twin in TWINS):
            lines.append(f"| {row[DATA]} | {row[START]} | {counted[key]} | {row[RMSE]} | {row[COVERAGE]} |")
    return lines


def motion_excerpt(rows: list[dict[str, str]]) -> list[str]:
    """The lines about speed, slip and range, none where no row has a goal."""
    with_goal = [row for row in rows if row[GOAL]]
    if not with_goal:
        return []
    firsts = {row[DATA].split(",")[0]: row for row in reversed(with_goal)}
    wanted = [row for row in with_goal if row in firsts.values() or MISSED in row.values()]
    met = sum(MISSED not in row.values() for row in with_goal)
    lines = [
        "",
        f"Speed, slip and range: {met} of {len(with_goal)} goals are met. The first goal of each robot or plant, and",
        "those that were missed:",
        "",
        "| recording or plant | method | what | measured | goal | |",
        "|---|---|---|---|---|---|",
    ]
    columns = (DATA, METHOD, QUANTITY, VALUE, GOAL)
    cells = [(*(row[c] for c in columns), MISSED if MISSED in row.values() else "") for row in wanted]
    return lines + [f"| {' | '.join(row)} |" for row in cells]


if __name__ == "__main__":
    main()
