"""The flash that an export is said to take, against what the cross compiler makes of it."""

import shutil
import subprocess

import pytest

from embedded.batteries import BATTERY, soc_export
from ohmward.embedded import controller_export, library, write_library
from ohmward.embedded.c_library import size
from ohmward.traction import RLMA

COMPILER = "arm-none-eabi-gcc"
CORTEX_M4F = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "-Os", "-std=c99"]
FIXED = ("textbook-ekf", "textbook-ukf", "textbook-joint")
CASES = [
    *((name, sample_time_s, "lines") for name in ("coulomb", *FIXED) for sample_time_s in (None, 1.0)),
    *((name, sample_time_s, "loops") for name in FIXED for sample_time_s in (None, 1.0)),
    ("ekf", None, "lines"),
    ("rc", None, "lines"),
]


def measured(export, folder):
    """Bytes of code and constants in the object."""
    write_library(library(export), folder)
    source, target = folder / f"{export.name}.c", folder / "object.o"
    command = [COMPILER, *CORTEX_M4F, "-ffp-contract=off", "-fno-math-errno", "-c", "-o", target, source]
    subprocess.run(command, check=True)
    lines = subprocess.run(["arm-none-eabi-size", target], capture_output=True, text=True, check=True).stdout
    text, data, bss = map(int, lines.splitlines()[1].split()[:3])
    assert data == bss == 0
    return text


@pytest.mark.skipif(not shutil.which(COMPILER), reason=f"{COMPILER} is not installed")
@pytest.mark.parametrize(("name", "sample_time_s", "style"), CASES)
def test_flash_is_estimated_within_a_sixth(name, sample_time_s, style, tmp_path):
    export = soc_export(name, sample_time_s=sample_time_s, style=style)
    assert size(export).flash == pytest.approx(measured(export, tmp_path), rel=1 / 6)


@pytest.mark.skipif(not shutil.which(COMPILER), reason=f"{COMPILER} is not installed")
def test_that_of_a_controller_too(tmp_path):
    export = controller_export(RLMA, "slip-controller", "wheel")
    assert size(export).flash == pytest.approx(measured(export, tmp_path), rel=1 / 6)


@pytest.mark.skipif(not shutil.which(COMPILER), reason=f"{COMPILER} is not installed")
def test_the_bare_filters_stay_small(tmp_path):
    """Code and tables: the textbook filter's curve apart 2 KB, the joint filter 9 KB as lines and 1.7 KB as loops."""
    joint, loops = (soc_export("textbook-joint", style=style) for style in ("lines", "loops"))
    assert measured(joint, tmp_path / "lines") < 9 * 1024
    assert measured(loops, tmp_path / "loops") <= 1.7 * 1024
    textbook = soc_export("textbook-ukf", sample_time_s=1.0)
    curve = 4 * 4 * (len(BATTERY.thevenin.ocv.voltage_V) + 1)
    assert measured(textbook, tmp_path / "textbook") - curve < 1536
