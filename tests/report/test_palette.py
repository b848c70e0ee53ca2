"""Colours: one meaning each, seen on their background, told apart by colour-blind readers."""

from itertools import combinations

import numpy as np
import pytest

from ohmward.report.figure import CYCLE, MEANING, SHADES, SURFACES, colours, css_variables

# Machado, Oliveira and Fernandes (2009), severity 1: linear RGB as seen with each colour blindness.
BLINDNESS = {
    "none": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(colour):
    srgb = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    t = XYZ @ np.clip(rgb, 0, 1) / XYZ.sum(axis=1)
    f = np.where(t > 216 / 24389, np.cbrt(t), (24389 / 27 * t + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def contrast(one, other):
    light, dark = sorted((XYZ[1] @ linear(c) for c in (one, other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("name", SHADES)
def test_lines_have_the_contrast_that_wcag_asks_of_graphics(name, theme):
    assert contrast(getattr(SHADES[name], theme), getattr(SURFACES["card"], theme)) >= 3


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("name", ["soft"])
def test_small_text_has_the_contrast_that_wcag_asks_of_text(name, theme):
    assert contrast(getattr(SURFACES[name], theme), getattr(SURFACES["card"], theme)) >= 4.5


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("blindness", BLINDNESS)
def test_the_first_hues_and_the_meanings_are_told_apart(blindness, theme):
    for names in (CYCLE[:4], ("blue", "orange", "ink", "grey")):
        seen = [lab(BLINDNESS[blindness] @ linear(getattr(SHADES[n], theme))) for n in names]
        assert min(np.linalg.norm(a - b) for a, b in combinations(seen, 2)) > 12


def test_auto_takes_the_next_hue_that_no_meaning_uses():
    assert colours(["auto", "estimate", "reference", "auto"]) == ["orange", MEANING["estimate"], "ink", "green"]
    assert colours(["auto"] * 8) == [*CYCLE, "blue", "orange"]


def test_the_style_sheet_gets_every_colour():
    assert "--blue:#0072b2;" in css_variables("light")
    assert css_variables("dark").count("--") == len(SHADES) + len(SURFACES)
