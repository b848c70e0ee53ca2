"""Steps as loops: the bits of the straight line, sample by sample, in less code; compiled as their user would."""

import subprocess

import numpy as np
import pytest

from embedded.batteries import soc_export, soc_library
from needs import needs_cppcheck, needs_gcc
from ohmward.battery.soc.sample import SocSample
from ohmward.embedded import Twin, library, write_library
from ohmward.embedded.battery import WITH_LOOPS
from ohmward.embedded.c_library import check_fits, size
from ohmward.errors import InputError

every_filter = pytest.mark.parametrize("name", WITH_LOOPS)
every_rate = pytest.mark.parametrize("sample_time_s", [None, 0.5])


def written(folder, name, style="loops", sample_time_s=None):
    export = soc_export(name, sample_time_s=sample_time_s, style=style)
    write_library(library(export), folder)
    return export


def checked(folder, *arguments):
    command = ["make", "-s", "-C", folder, "CFLAGS=-O1 -Werror", *arguments, "test"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@needs_gcc
@every_filter
@every_rate
def test_the_vectors_of_the_straight_line_pass_to_the_last_bit(name, sample_time_s, tmp_path):
    written(tmp_path, name, sample_time_s=sample_time_s)
    result = checked(tmp_path)
    assert result.returncode == 0 and not result.stderr, result.stdout + result.stderr
    assert "64 of 64 vectors right to the last bit" in result.stdout
    assert "for (int" in (tmp_path / "soc.c").read_text() and "has loops" in (tmp_path / "README.md").read_text()


@needs_gcc
@every_filter
def test_a_long_log_gives_the_bits_of_the_straight_line(name, tmp_path):
    pytest.importorskip("cffi")
    samples = a_log(5000)
    results = []
    for style in ("lines", "loops"):
        export = written(tmp_path / style, name, style)
        twin = Twin(tmp_path / style)
        first = SocSample(*(float(column[0]) for column in samples))
        twin.start(first, **dict(zip(twin.arguments, export.arguments, strict=True)))
        results.append(twin.run(samples))
    for lines, loops in zip(*results, strict=True):
        np.testing.assert_array_equal(loops, lines)
        assert np.isfinite(lines).mean() > 0.9 or np.isnan(lines).all()


def a_log(steps):
    """Samples (steps,) of a drive with a gap, and with values that are missing."""
    rng = np.random.default_rng(4)
    current_A = np.repeat(rng.normal(-4.0, 6.0, steps // 20), 20)
    voltage_V = 13.2 + 0.016 * current_A + 0.003 * rng.standard_normal(steps)
    dt_s = rng.choice([0.0, 0.5, 1.0], steps, p=[0.02, 0.18, 0.8])
    for column in (current_A, voltage_V, dt_s):
        column[rng.random(steps) < 0.01] = np.nan
    voltage_V[0], dt_s[0], dt_s[steps // 2] = 13.2, 0.0, 30.0
    return SocSample(dt_s, current_A, voltage_V, np.full(steps, 25.0))


@needs_gcc
@every_filter
def test_sanitizers_find_nothing(name, tmp_path):
    written(tmp_path, name)
    result = checked(tmp_path, "TARGET=-fsanitize=address,undefined -fno-sanitize-recover=all")
    assert result.returncode == 0, result.stdout + result.stderr


@every_filter
@needs_cppcheck
def test_cppcheck_finds_nothing(name, tmp_path):
    written(tmp_path, name)
    command = ["cppcheck", "--quiet", "--enable=warning,portability", "--error-exitcode=1", tmp_path / "soc.c"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


@every_filter
def test_the_header_and_the_vectors_are_those_of_the_straight_line(name):
    lines, loops = (soc_library(name, style=style) for style in ("lines", "loops"))
    assert loops["soc.h"] == lines["soc.h"] and loops["soc_vectors.h"] == lines["soc_vectors.h"]
    assert loops["soc.c"] != lines["soc.c"]


def test_no_function_is_without_its_prefix():
    source = soc_library("textbook-joint", "pack", style="loops")["pack.c"]
    functions = [line for line in source.splitlines() if line.startswith(("static", "void"))]
    assert len(functions) > 5 and all("pack_" in line for line in functions)


def test_other_filters_have_no_loops_and_say_which_have():
    with pytest.raises(InputError, match="ekf has no loops, only textbook-ekf, textbook-ukf, textbook-joint have"):
        soc_export("ekf", style="loops")
    with pytest.raises(InputError, match="style must be one of lines, loops, got 'rolled'"):
        soc_export("textbook-ekf", style="rolled")


def test_loops_fit_where_the_straight_line_does_not():
    lines, loops = (soc_export("textbook-joint", style=style) for style in ("lines", "loops"))
    check_fits(loops, 2048.0, 256.0)
    with pytest.raises(InputError, match=r"bytes of flash, more than the 2048 there are.*--style loops"):
        check_fits(lines, 2048.0, 256.0)
    assert size(loops).state == size(lines).state == 4 * (7 + 28 + 3 + 7 + 1)
