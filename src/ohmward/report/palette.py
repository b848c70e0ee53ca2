"""The colours of plots, once: what each means, in light and in dark."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

Meaning = Literal["estimate", "comparison", "reference", "background", "alert"]
Role = Meaning | Literal["auto"]
Theme = Literal["light", "dark"]


class Shade(NamedTuple):
    """One colour as `#rrggbb`, on a light and on a dark background."""

    light: str
    dark: str


# Hues after Okabe and Ito, "Color Universal Design" (2008): told apart with every common colour blindness.
SHADES: Final[dict[str, Shade]] = {
    "blue": Shade("#0072b2", "#56a9e8"),
    "orange": Shade("#d55e00", "#ff9a57"),
    "green": Shade("#009e73", "#2fc99b"),
    "purple": Shade("#a6487f", "#e0a0cb"),
    "amber": Shade("#9a6700", "#f2d060"),
    "sky": Shade("#3a9bd9", "#a8dcff"),
    "ink": Shade("#1f2933", "#eef2f6"),
    "grey": Shade("#7b8794", "#8b98a5"),
    "red": Shade("#c8102e", "#ff6b6b"),
}
SURFACES: Final[dict[str, Shade]] = {
    "paper": Shade("#f6f7f9", "#12161c"),
    "card": Shade("#ffffff", "#1a2029"),
    "soft": Shade("#5f6c7b", "#9aa7b5"),
    "rule": Shade("#e1e5ea", "#2c3541"),
    "grid": Shade("#eceff3", "#252d38"),
}
CYCLE: Final = ("blue", "orange", "green", "purple", "amber", "sky")
MEANING: Final[dict[Meaning, str]] = {
    "estimate": "blue",
    "comparison": "orange",
    "reference": "ink",
    "background": "grey",
    "alert": "red",
}
ROLES: Final = ("auto", *MEANING)


def colours(roles: Sequence[Role]) -> list[str]:
    """A name in `SHADES` for each role; "auto" takes the next hue of `CYCLE` that no other role of the list uses."""
    taken = {MEANING[role] for role in roles if role != "auto"}
    free = [hue for hue in CYCLE if hue not in taken] or list(CYCLE)
    count = 0
    names = []
    for role in roles:
        names.append(free[count % len(free)] if role == "auto" else MEANING[role])
        count += role == "auto"
    return names


def css_variables(theme: Theme) -> str:
    """`--paper:#f6f7f9;--blue:#0072b2;...` for a style sheet."""
    return "".join(f"--{name}:{getattr(shade, theme)};" for name, shade in (SURFACES | SHADES).items())
