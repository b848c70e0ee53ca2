"""Fill the pages of the two publications: `python docs/fill_publications.py`.

The claims of each and their verdicts come from the rows of `benchmarks/publications.md`, which `ohmward reproduce`
computes; the tables of errata from the list that `ohmward reproduce errata` checks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from marked_block import replaced

from ohmward_lab.reproduce.errata import ERRATA

ROOT = Path(__file__).parents[1]
NUMBERS = ROOT / "benchmarks" / "publications.md"
PAGES = {"[T]": ROOT / "docs" / "reproduce-thesis.md", "[P]": ROOT / "docs" / "reproduce-paper.md"}
ERRATA_PAGE = ROOT / "docs" / "theory" / "where-the-texts-are-wrong.md"
METHODS = ("EKF", "AEKF", "UKF", "AUKF")
SLA, LFP = "sealed lead-acid 12 V 5 Ah", "LFP 12 V 6 Ah"


class Claim(NamedTuple):
    """A claim of a publication.

    place: where it stands.
    claim: in our words.
    equation: that it rests on.
    numbers: quantity and column of our numbers, by a name of each.
    holds: the verdict on these numbers, in this order.
    """

    place: str
    claim: str
    equation: str
    numbers: dict[str, tuple[str, str]]
    holds: Callable[..., bool]


def before(method: str, column: str = "corrected") -> tuple[str, str]:
    """Mean voltage error of a method of [T] before the sample."""
    return f"Voltage before the sample, {method}: mean", column


def after(method: str, column: str = "corrected") -> tuple[str, str]:
    """Mean voltage error of a method of [T] after the sample."""
    return f"Voltage after the sample, {method}: mean", column


def soc(method: str) -> tuple[str, str]:
    """Mean error of the state of charge by a method of [T]."""
    return f"SoC, 98 to 90 %, {method}: mean", "corrected"


def orders(what: str) -> dict[str, tuple[str, str]]:
    """Shares of the drives in which a method of [T] is better than one that it places behind."""
    pairs = (("AUKF", "UKF"), ("AUKF", "AEKF"), ("AEKF", "EKF"), ("AEKF", "UKF"), ("UKF", "EKF"))
    return {f"{a} < {b}": (f"{a} < {b} in {what}, mean after 100 s, share of drives", "corrected") for a, b in pairs}


def every(*shares: float) -> bool:
    """True where an order holds in every drive."""
    return all(share == 100.0 for share in shares)


RC, UKF = "(19)-(25)", "(26)-(44)"
CLAIMS = {
    "[T]": (
        Claim(
            "3.3.1",
            "with $dI/dt = 0$ the parameters can be found along a drive",
            "$f_3$ in (3.6)",
            {"EKF, before": before("EKF", "as printed"), "EKF corrected": before("EKF")},
            lambda printed, corrected: printed < 2 * corrected,
        ),
        Claim(
            "3.3.5",
            "with (3.51) the UKF is stable",
            "(3.31)-(3.48), (3.51)",
            {"as printed": before("UKF", "as printed"), "parameters bounded": before("UKF")},
            lambda printed, bounded: printed < 1.0,
        ),
        Claim(
            "table 3.1",
            "the model found offline errs by 0.018 V in the mean",
            "(3.1)",
            {"rule": ("Voltage, offline model: mean", "as printed")},
            lambda error: error <= 0.018,
        ),
        Claim(
            "table 3.2",
            "the AUKF errs by 0.002 V in the mean (after the sample)",
            "(3.49)",
            {"AUKF": after("AUKF")},
            lambda error: error <= 0.002,
        ),
        Claim(
            "table 3.2",
            "the same, before the sample",
            "(3.13)",
            {"AUKF": before("AUKF"), "8 bit": before("AUKF, 8 bit oscilloscope")},
            lambda error, scope: error <= 0.002,
        ),
        Claim(
            "table 3.2",
            "the UKF errs by 0.012 V in the mean (after the sample)",
            "(3.46), (3.47)",
            {"UKF": after("UKF")},
            lambda error: error <= 0.012,
        ),
        Claim(
            "table 3.2",
            "nearest to the voltage is the AUKF, then AEKF, UKF, EKF (here % of the drives)",
            "(3.31)-(3.50)",
            orders("voltage after the sample"),
            every,
        ),
        Claim(
            "table 3.3",
            "the AUKF's state of charge errs by 0.028 % in the mean",
            "3.4.2",
            {"AUKF": soc("AUKF"), "EKF": soc("EKF"), "default": ("SoC, 98 to 90 %, AUKF: mean", "default")},
            lambda aukf, ekf, default: aukf <= 0.028,
        ),
        Claim(
            "table 3.3",
            "nearest to the count is the AUKF, then AEKF, UKF, EKF (here % of the drives)",
            "3.4.2",
            orders("SoC"),
            every,
        ),
        *(
            Claim(
                f"figure {figure}",
                f"the AUKF's error covariance of the {of} is the smallest",
                "(3.49), (3.50)",
                {
                    f"{name} [{unit}, root]" if name == METHODS[0] else name: (
                        f"Standard deviation of {quantity} by {name} itself",
                        "corrected",
                    )
                    for name in METHODS
                },
                lambda ekf, aekf, ukf, aukf: aukf < min(ekf, aekf, ukf),
            )
            for figure, of, quantity, unit in (
                ("3.12", "voltage", "the voltage", "mV"),
                ("3.15", "state of charge", "SoC", "%"),
            )
        ),
        *(
            Claim(
                f"figures {figures}",
                f"the AUKF is nearer to the {of} than the UKF, {with_noise}",
                "(4.13)-(4.20), (3.50)",
                {
                    f"UKF [{unit}]": (f"Forward, noise at first: {noise}: {quantity}, UKF", "corrected"),
                    "AUKF": (f"Forward, noise at first: {noise}: {quantity}, AUKF", "as printed"),
                    "R matched alone": (f"Forward, noise at first: {noise}: {quantity}, AUKF", "corrected"),
                },
                lambda ukf, aukf, alone: aukf < ukf,
            )
            for figures, of, quantity, unit in (
                ("4.7-4.11", "wheel's speed", "wheel speed", "rad/s"),
                ("4.13-4.16", "robot's speed", "speed", "mm/s"),
            )
            for noise, with_noise in (
                ("right", "here from a right R"),
                ("R / 100", "from an R a hundred times too small"),
            )
        ),
        Claim(
            "5.4, figures 5.6, 5.8",
            "the slip follows the wanted one after a short transient",
            "(5.22)-(5.47)",
            {
                "I, within 0.02 after [s]": ("Case I, slip of -0.18: time until within 0.02", "corrected"),
                "II": ("Case II, slip of 0.12: time until within 0.02", "corrected"),
            },
            lambda one, two: max(one, two) < 1.0,
        ),
        Claim(
            "5.4",
            "case I: a slip of -0.18 is held for 6 s",
            "(5.22)-(5.47)",
            {"stands on ice after [s]": ("Case I, from 0.2 m/s on ice: time at -0.18", "corrected")},
            lambda time_s: time_s >= 6.0,
        ),
        Claim(
            "5.4",
            "case II: at -0.18 the robot travels 1.5 m",
            "(5.22)-(5.47)",
            {"stands on ice after [m]": ("Case II, from 0.2 m/s on ice: way at -0.18", "corrected")},
            lambda way_m: way_m >= 1.5,
        ),
    ),
    "[P]": (
        Claim(
            "2.2",
            "$R_b = R_s$ = 75 % of the total resistance, $R_t$ the rest",
            "$R_t = R_{total} - R_b / 2$",
            {"R_t / R_total": (f"{SLA}: R_t / R_total", "as printed")},
            lambda share: abs(share - 0.625) < 1e-3,
        ),
        Claim(
            "2.3, figure 5",
            "two time constants fit a relaxation better than one",
            "(18)",
            {
                "one [mV]": (f"{SLA}: one time constant, RMS of ", "corrected"),
                "two": (f"{SLA}: two time constants, RMS", "corrected"),
            },
            lambda one, two: two < one,
        ),
        Claim(
            "2.3, figure 7",
            "the nonlinear fit refines the first parameters",
            "(11)-(14)",
            {
                "before [mV]": (f"{SLA}: before the nonlinear fit, RMS", "corrected"),
                "after": (f"{SLA}: after it, RMS", "corrected"),
            },
            lambda first, last: last < first,
        ),
        Claim(
            "4.2",
            "the LFP curve rises by 0.024 V from 75 to 98 %",
            "figure 8",
            {
                "identified [V]": (f"{LFP}: rise of the curve, 75% to 98%", "as printed"),
                "simulated": (f"{LFP}: rise of the curve, 75% to 98%", "default"),
            },
            lambda found, true: abs(found - 0.024) <= 0.2 * 0.024,
        ),
        Claim(
            "4.2",
            "and by less than 0.2 V from 25 to 65 %",
            "figure 8",
            {"identified [V]": (f"{LFP}: rise of the curve, 25% to 65%", "as printed")},
            lambda found: found < 0.2,
        ),
        Claim(
            "4",
            "the reference is within 83 mAh",
            "0.8 % of 25 A; 25 minutes, not printed",
            {"mAh": (f"{SLA}, error of the count at the end, largest of three sensors (mAh)", "corrected")},
            lambda mAh: mAh <= 83.0,
        ),
        Claim(
            "4.1",
            "RC + KF finds back from 20 points off within 500 s",
            RC,
            {
                "at 1 A left of 20, P0 = I": (
                    f"{SLA} at 1 A, RC + KF from 80%, P0 = I, against the truth: after 500 s",
                    "as printed",
                ),
                "P0 = 100 I": (
                    f"{SLA} at 1 A, RC + KF from 80%, P0 = 100 I, against the truth: after 500 s",
                    "as printed",
                ),
            },
            lambda one, hundred: max(one, hundred) < 6.0,
        ),
        Claim(
            "5",
            "then its MAE on lead-acid is 2.2 %, its largest error 5 %",
            RC,
            {
                "MAE": (f"{SLA}, RC + KF after 500 s, against the count: MAE", "as printed"),
                "largest": (f"{SLA}, RC + KF after 500 s, against the count: largest", "as printed"),
            },
            lambda mean, largest: mean <= 2.2 and largest <= 5.0,
        ),
        Claim(
            "4.1",
            "T2RC + UKF on lead-acid: MAE of 0.27 %",
            UKF,
            {"MAE": (f"{SLA}, T2RC + UKF from a right start, against the count: MAE", "as printed")},
            lambda mean: mean <= 1.2 * 0.27,
        ),
        Claim(
            "4.2",
            "T2RC + UKF on LFP: MAE of 0.5 %",
            UKF,
            {"MAE": (f"{LFP}, T2RC + UKF from a right start, against the count: MAE", "as printed")},
            lambda mean: mean <= 1.2 * 0.5,
        ),
        Claim(
            "figure 11b",
            "on lead-acid the Thevenin model's voltage error is the larger",
            "(14)",
            {
                "T2RC [mV]": (f"{SLA}, voltage before the sample, T2RC + UKF: MAE", "as printed"),
                "RC before": (f"{SLA}, voltage before the sample, RC + KF: MAE", "as printed"),
                "RC after": (f"{SLA}, voltage after the sample, RC + KF: MAE", "as printed"),
            },
            lambda t2rc, rc, rc_after: t2rc > rc,
        ),
        Claim(
            "figure 12",
            "T2RC + UKF on lead-acid does not find back from 10 points off",
            UKF,
            {"left": (f"{SLA}, T2RC + UKF started at 90% when full: size of the error at the end", "as printed")},
            lambda left: left > 5.0,
        ),
        Claim(
            "abstract",
            "the Thevenin model's MAE is below 1 % for both",
            UKF,
            {
                "lead-acid": (f"{SLA}, T2RC + UKF from a right start, against the count: MAE", "as printed"),
                "LFP": (f"{LFP}, T2RC + UKF from a right start, against the count: MAE", "as printed"),
            },
            lambda *means: max(means) < 1.0,
        ),
        Claim(
            "4.2, figure 13",
            "RC + KF on LFP is poor",
            RC,
            {"MAE": (f"{LFP}, RC + KF after 500 s, against the count: MAE", "as printed")},
            lambda mean: mean > 2.2,
        ),
        Claim(
            "5",
            "the Thevenin model for use and the RC model to start and correct it are better than the former alone",
            "`published.hybrid`",
            {
                "hybrid, lead-acid": (f"{SLA}, hybrid, right start, against the truth: MAE", "as printed"),
                "T2RC": (f"{SLA}, T2RC + UKF, right start, against the truth: MAE", "as printed"),
                "hybrid, LFP": (f"{LFP}, hybrid, right start, against the truth: MAE", "as printed"),
                "T2RC on LFP": (f"{LFP}, T2RC + UKF, right start, against the truth: MAE", "as printed"),
            },
            lambda a, b, c, d: a < b and c < d,
        ),
    ),
}


def main() -> None:
    """Rewrite the blocks between the markers."""
    numbers = NUMBERS.read_text(encoding="utf-8")
    for short, page in PAGES.items():
        page.write_text(filled(page.read_text(encoding="utf-8"), short, numbers), encoding="utf-8")
    ERRATA_PAGE.write_text(with_errata(ERRATA_PAGE.read_text(encoding="utf-8")), encoding="utf-8")


def filled(text: str, short: str, numbers: str) -> str:
    """The text of a publication's page with its claims made anew."""
    return replaced(text, "claims", claim_lines(CLAIMS[short], rows_of(numbers)))


def rows_of(numbers: str) -> dict[str, dict[str, str]]:
    """Cells of every row by its quantity; the number of rests is left out, a second unit of a quantity is named."""
    found: dict[str, dict[str, str]] = {}
    for line in numbers.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 6 and line.startswith("| "):
            quantity, unit, _, as_printed, corrected, default = cells
            name = f"{quantity} ({unit})" if quantity in found else quantity
            found[name] = {"as printed": as_printed, "corrected": corrected, "default": default}
    return found


def cell(rows: dict[str, dict[str, str]], quantity: str, column: str) -> str:
    """One number as the page has it; a quantity may be the beginning of its name."""
    name = quantity if quantity in rows else next(name for name in rows if name.startswith(quantity))
    return rows[name][column]


def claim_lines(claims: tuple[Claim, ...], rows: dict[str, dict[str, str]]) -> Iterator[str]:
    """A row for each claim."""
    yield from ("| place | claim | equation | here | verdict |", "|---|---|---|---|---|")
    for claim in claims:
        cells = [cell(rows, *where) for where in claim.numbers.values()]
        here = "; ".join(f"{name} {value}" for name, value in zip(claim.numbers, cells, strict=True))
        verdict = "holds" if claim.holds(*map(float, cells)) else "**not here**"
        yield f"| {claim.place} | {claim.claim} | {claim.equation} | {here} | {verdict} |"


def with_errata(text: str) -> str:
    """The page of errata with its tables made anew."""
    for short, name in (("[T]", "thesis"), ("[P]", "paper")):
        text = replaced(text, name, errata_lines(short))
    return text


def errata_lines(short: str) -> Iterator[str]:
    """A row for each error that is checked."""
    yield from ("| place | in the text | must be |", "|---|---|---|")
    for erratum in ERRATA:
        if erratum.text == short:
            cells = (c.replace("|", "\\|") for c in (erratum.place, erratum.printed, erratum.correct))
            yield f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
