"""Exported filters, compiled and run as their user would: the vectors pass, the compiler has nothing to say."""

import re
import shutil
import subprocess

import numpy as np
import pytest

from embedded.batteries import BATTERY, soc_export, soc_library
from needs import needs_cppcheck, needs_gcc
from ohmward.battery.soc.registry import available, make_estimator
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.embedded import library, write_library
from ohmward.embedded.c_library import check_fits, size
from ohmward.embedded.comments import field_comments, flag_comments
from ohmward.errors import InputError, OhmwardError
from ohmward.trace import Kernel, single_precision
from ohmward.traction import control
from ohmward.traction.speed_observer import estimate as observers

CALLER = """\
#include "soc.h"

int main()
{
    soc_state state;
    const soc_sample sample = {0.0f, -1.0f, 13.2f, 25.0f};
    soc_output output;
    soc_start(&state, &sample, 0.5f, 0.3f);
    soc_step(&state, &sample, &output);
    return output.soc > 0.0f && output.soc < 1.0f ? 0 : 1;
}
"""


def made(folder, *arguments):
    return subprocess.run(
        ["make", "-s", "-C", folder, "CFLAGS=-O1 -Werror", *arguments], capture_output=True, text=True, check=False
    )


#: Those that are compiled with optimisation; the others are the same kinds of program, and take the compiler long.
OPTIMISED = ("ekf", "textbook-ukf", "coulomb", "textbook-joint")


@needs_gcc
@pytest.mark.parametrize("name", OPTIMISED)
def test_the_vectors_pass_to_the_last_bit_and_the_compiler_is_silent(name, tmp_path):
    write_library(soc_library(name), tmp_path)
    result = made(tmp_path, "test")
    assert result.returncode == 0 and not result.stderr, result.stdout + result.stderr
    assert "64 of 64 vectors right to the last bit" in result.stdout


@needs_gcc
def test_a_wrong_bit_is_found(tmp_path):
    files = dict(soc_library("coulomb"))
    files["soc.c"] = files["soc.c"].replace("output->soc_std = ", "output->soc_std = 1.0000001f * ")
    write_library(files, tmp_path)
    result = made(tmp_path, "test")
    assert result.returncode != 0 and "is wrong" in result.stdout


@needs_gcc
def test_sanitizers_find_nothing(tmp_path):
    write_library(soc_library("ekf"), tmp_path)
    result = made(tmp_path, "test", "TARGET=-fsanitize=address,undefined -fno-sanitize-recover=all")
    assert result.returncode == 0, result.stdout + result.stderr


@needs_gcc
@needs_cppcheck
def test_cppcheck_finds_nothing(tmp_path):
    write_library(soc_library("textbook-ekf"), tmp_path)
    command = ["cppcheck", "--quiet", "--enable=warning,portability", "--error-exitcode=1", tmp_path / "soc.c"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


@needs_gcc
@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in available(BATTERY) if name not in OPTIMISED])
def test_every_other_estimator_can_be_exported(name, tmp_path):
    write_library(soc_library(name), tmp_path)
    assert made(tmp_path, "test", "CFLAGS=-O0 -Werror").returncode == 0


def test_single_precision_is_good_enough():
    export = soc_export("ekf")
    samples = np.nan_to_num(export.samples, nan=0.0, posinf=13.2)[:40]
    estimator = make_estimator("ekf", BATTERY)
    start = estimator.init(SocSample(0.0, 0.0, 13.2, 25.0), 0.5, 0.3)
    kernel = Kernel(estimator.step, start, SocSample(0.0, 0.0, 0.0, 0.0), lowering="python")
    _, double = kernel.scan(start, SocSample(*samples.T))
    flat = np.concatenate([np.ravel(x) for part in start for x in (part if isinstance(part, tuple) else (part,))])
    _, single = single_precision.run(export.step, flat.astype(float), samples)
    np.testing.assert_allclose(single[:, 0], double.soc, atol=2e-4)
    np.testing.assert_allclose(single[:, 1], double.soc_std, rtol=2e-3)


def test_the_header_says_what_the_docstrings_say():
    header = soc_library("ekf")["soc.h"]
    assert "float voltage_V; /* measured terminal voltage [V] of the whole pack */" in header
    assert "#define SOC_VOLTAGE_REJECTED 16 /* innovation outside its gate, or a jump" in header
    assert "void soc_start(soc_state *state, const soc_sample *sample, float soc, float soc_std);" in header


def test_the_readme_says_what_the_flags_mean_and_how_to_ask():
    text = soc_library("ekf")["README.md"]
    assert "| `SOC_GAP` | 8 | step too long to assume a straight line between its two currents |" in text
    assert "(unsigned)output.flags & SOC_NO_CURRENT" in text


@pytest.mark.parametrize("flags", [SocFlag, observers.SlipFlag, control.ControlFlag])
def test_every_flag_has_its_comment(flags):
    assert set(flag_comments(flags)) == set(flags.__members__)


@needs_gcc
def test_a_start_that_few_digits_cannot_tell_passes_too(tmp_path):
    write_library(soc_library("textbook-ekf", soc=0.123456789, soc_std=0.0123456789), tmp_path)
    result = made(tmp_path, "test")
    assert result.returncode == 0, result.stdout + result.stderr


def test_comments_come_from_docstrings_of_several_lines():
    comments = field_comments(SocSample)
    assert comments["dt_s"] == "time since the sample before [s]; 0 for the first"
    assert set(comments) == set(SocSample._fields)


def test_no_symbol_is_without_its_prefix(tmp_path):
    source = soc_library("textbook-ukf", "pack")["pack.c"]
    functions = [line for line in source.splitlines() if line.startswith(("static", "void"))]
    assert functions and all("pack_" in line for line in functions)


@pytest.mark.parametrize("name", ["textbook-ekf", "textbook-joint"])
@pytest.mark.parametrize("sample_time_s", [None, 0.5])
def test_a_library_at_a_constant_rate_says_that_it_uses_no_time(name, sample_time_s):
    said = "a step every 0.5 s (`dt_s` is not used)" in soc_library(name, sample_time_s=sample_time_s)["README.md"]
    assert said == (sample_time_s is not None)


@pytest.mark.skipif(not shutil.which("g++"), reason="g++ is not installed")
def test_a_caller_in_cpp_needs_no_more_than_the_header(tmp_path):
    write_library(soc_library("textbook-ekf"), tmp_path)
    assert made(tmp_path, "lib").returncode == 0
    (tmp_path / "main.cpp").write_text(CALLER)
    strict = ["-std=c++17", "-Wall", "-Wextra", "-pedantic", "-Werror"]
    command = ["g++", *strict, "-o", tmp_path / "main", tmp_path / "main.cpp", tmp_path / "libsoc.a", "-lm"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert subprocess.run([tmp_path / "main"], check=False).returncode == 0


@needs_gcc
@pytest.mark.parametrize("style", ["lines", "loops"])
@pytest.mark.parametrize("name", ["textbook-ekf", "textbook-ukf"])
def test_a_curve_on_lines_is_small_and_right_to_the_last_bit(name, style, tmp_path):
    whole = soc_export(name, style=style)
    export = soc_export(name, style=style, curve_error_V=8e-3)
    assert size(export).flash < size(whole).flash - 2048
    assert re.search(r"curve within \d\.?\d? mV", export.title)
    write_library(library(export), tmp_path)
    result = made(tmp_path, "test")
    assert result.returncode == 0 and not result.stderr, result.stdout + result.stderr
    assert "uint8_t soc_table" in (tmp_path / "soc.c").read_text()


def test_a_curve_on_lines_changes_what_is_estimated_as_little_as_the_curve():
    samples = np.nan_to_num(soc_export("textbook-ukf").samples, nan=0.0, posinf=13.2)[:20]
    outputs = []
    for curve_error_V in (None, 4e-3):
        export = soc_export("textbook-ukf", curve_error_V=curve_error_V)
        start = single_precision.evaluator(export.start)(np.array([*samples[0], 0.5, 0.01], np.float32))
        outputs.append(single_precision.run(export.step, start, samples)[1])
    assert 0.0 < np.abs(outputs[1][:, 2] - outputs[0][:, 2]).max() < 8e-3


@pytest.mark.parametrize("name", ["ekf", "coulomb"])
def test_a_curve_error_is_for_filters_of_the_curve_alone(name):
    with pytest.raises(InputError, match="a curve error is for textbook-ekf, textbook-ukf"):
        soc_export(name, curve_error_V=1e-3)
    with pytest.raises(InputError, match="textbook-joint has no open-circuit voltage curve"):
        soc_export("textbook-joint", curve_error_V=1e-3)


def test_what_does_not_fit_is_refused_before_anything_is_written():
    export = soc_export("ekf")
    check_fits(export, size(export).flash, size(export).state)
    with pytest.raises(InputError, match="bytes of flash, more than the 2048 there are"):
        check_fits(export, 2048.0, None)
    with pytest.raises(InputError, match="bytes of RAM"):
        check_fits(export, None, 64.0)


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OhmwardError, match="cannot be made"):
        write_library({"a.c": ""}, tmp_path / "file" / "folder")


def test_files_that_no_export_wrote_are_kept(tmp_path):
    files = dict(soc_library("coulomb"))
    write_library(files, tmp_path / "own")
    write_library(files, tmp_path / "own")
    (tmp_path / "Makefile").write_text("all: mine")
    with pytest.raises(OhmwardError, match=r"Makefile was not written by ohmward, and is kept; choose another folder"):
        write_library(files, tmp_path)
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["Makefile"]
    (tmp_path / "README.md").write_text("# Rover\n\nIts charge comes from a filter that was exported by ohmward.\n")
    with pytest.raises(OhmwardError, match=r"was not written by ohmward"):
        write_library(files, tmp_path)
