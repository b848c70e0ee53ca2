"""Libraries on the emulated microcontroller; skipped where the cross compiler or the emulator is missing."""

import shutil
import subprocess
from functools import cache

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc.sample import SocSample
from ohmward.cli.main import main as ohmward
from ohmward.embedded import battery_export, controller_export, observer_export
from ohmward.logs import Log, write_log
from ohmward.traction import RLMA, hard_terrain
from scripts import script

pytest.importorskip("cffi", reason="pip install cffi for the twin")
measure, cycles, emulator = (script(name, "firmware") for name in ("measure", "cycles", "emulator"))

MISSING = [tool for tool in (*emulator.TOOLS, "gcc") if not shutil.which(tool)]
needs_tools = pytest.mark.skipif(
    bool(MISSING), reason=f"no microcontroller to emulate here, {', '.join(MISSING)} missing: {emulator.INSTALL}"
)
BATTERY = generic_battery("nmc", 2.0)


@cache
def textbook():
    """The textbook filter, exported; not while the tests are collected."""
    return battery_export(BATTERY, "textbook-ekf", "filter", sample_time_s=1.0)


def a_log(steps):
    """Samples (steps,) of a drive, not a whole number of blocks, with values lost and wild."""
    rng = np.random.default_rng(2)
    current = rng.normal(-1.0, 1.0, steps)
    return measure.faulty(SocSample(np.ones(steps), current, 3.6 + 0.02 * current, np.full(steps, 25.0)))


def first(case, machine=measure.MACHINES[0], option="-O2"):
    return next(measure.measure(case, [option], [machine]))


@needs_tools
@pytest.mark.parametrize("machine", measure.MACHINES, ids=lambda m: m.name)
def test_every_bit_is_right_and_nothing_is_hidden(machine):
    found = first(measure.Case("textbook", textbook(), a_log(75)), machine, "-Os")
    assert found.wrong == 0 and found.answer.vectors.steps == 64 and found.answer.log.steps == 75
    assert found.state == 40 and 500 < found.sizes.code < 2048 and found.sizes.static == 0
    assert 100 < found.answer.vectors.least <= found.answer.vectors.mean <= found.most < 450
    assert 100 < found.answer.log.least <= found.mean <= found.most
    assert found.ram == 40 + 16 + 48 + found.answer.stack and 0 < found.answer.stack < 256


@needs_tools
def test_an_unknown_start_comes_from_the_first_voltage_there_too():
    found = first(measure.Case("ekf", battery_export(BATTERY, "ekf", "filter"), a_log(5)), option="-Os")
    assert found.wrong == 0 and found.answer.vectors.steps == 64


@needs_tools
@pytest.mark.usefixtures("quickly_compiled")
@pytest.mark.parametrize(
    "export",
    [
        lambda: controller_export(RLMA, "slip-controller", "filter"),
        lambda: observer_export(RLMA, hard_terrain("dry asphalt"), "ekf"),
    ],
    ids=["controller", "observer"],
)
def test_the_traction_half_runs_there_too(export):
    found = first(measure.Case("traction", export()), option="-O1")
    assert found.wrong == 0 and found.answer.vectors.steps == 64 and found.answer.log.steps == 0


@needs_tools
def test_a_wrong_bit_of_the_log_is_seen_and_named(monkeypatch, capsys):
    def miscompile(folder, name, option):
        source = folder / f"{name}.c"
        source.write_text(source.read_text().replace("output->soc_std = ", "output->soc_std = 1.0000001f * "))
        return emulator.compile_library(folder, name, option)

    monkeypatch.setattr(measure, "compile_library", miscompile)
    found = first(measure.Case("coulomb", battery_export(BATTERY, "coulomb", "filter"), a_log(40)))
    assert found.answer.wrong > 0 and found.wrong == found.answer.wrong + 40
    assert "sample 0: soc_std is " in capsys.readouterr().err


def replayed(folder):
    """The image of the textbook filter in a folder, and what it said of its vectors."""
    measure.write_library(measure.library(textbook()), folder)
    emulator.compile_library(folder, "filter", "-O2")
    image = emulator.link(folder, "filter", textbook().arguments, "-O2", measure.MACHINES[0])
    answer, _ = emulator.run(image, measure.MACHINES[0])
    return image, answer


@needs_tools
def test_the_painted_stack_is_what_the_compiler_says(tmp_path):
    _, answer = replayed(tmp_path)
    command = ["arm-none-eabi-gcc", *emulator.MACHINE_CODE, *emulator.ARITHMETIC, "-std=c99", "-O2", "-fstack-usage"]
    subprocess.run([*command, "-c", "-o", tmp_path / "x.o", tmp_path / "filter.c"], check=True)
    usage = {line.split("\t")[0].split(":")[-1]: line.split("\t")[1] for line in (tmp_path / "x.su").open()}
    assert answer.stack == int(usage["filter_step"])


@needs_tools
def test_executed_instructions_are_those_of_the_clock(tmp_path):
    image, answer = replayed(tmp_path)
    found = cycles.cycles(image, "filter", measure.MACHINES[0])
    assert answer.vectors.least - 20 <= found.instructions <= answer.vectors.most
    assert found.instructions < found.fewest < found.most < 4 * found.fewest


@needs_tools
def test_a_recorded_log_through_an_exported_library(tmp_path, monkeypatch, capsys):
    samples = a_log(50)
    write_log(Log("day", np.arange(50.0), samples.current_A, samples.voltage_V, None), tmp_path / "day.csv")
    monkeypatch.chdir(tmp_path)
    assert ohmward(["generic", "--chemistry", "nmc", "--capacity-ah", "2", "-o", "cell.toml"]) == 0
    assert ohmward(["export", "cell.toml", "--filter", "coulomb", "--name", "cell", "-o", "made"]) == 0
    assert measure.main(["made", "day.csv", "--current-sign", "charge"]) == 0
    text = capsys.readouterr().out
    assert text.count("50 samples") == 4 and text.count("0 outputs with other bits") == 4
    assert measure.main(["nothing", "day.csv"]) == 2
    assert "no exported library" in capsys.readouterr().err
    assert {p.name for p in tmp_path.iterdir()} == {"day.csv", "cell.toml", "made"}


def test_without_its_tools_it_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert measure.main([]) == 1
    assert "apt-get install" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("word", "operands", "count"),
    [
        ("add", "r0, r1", 1),
        ("vadd", "s0, s1, s2", 1),
        ("vmla", "s0, s1, s2", 3),
        ("vdivne", "s0, s1, s2", 14),
        ("vldr", "s0, [sp, #4]", 2),
        ("ldrb", "r0, [r1]", 2),
        ("push", "{r4, r5, lr}", 4),
        ("vpush", "{d8-d15}", 17),
        ("ldmia", "r0!, {r1-r3, r5}", 5),
    ],
)
def test_cycles_of_kinds_are_those_of_the_manual(word, operands, count):
    assert cycles._cycles_of(word, operands) == count


def test_a_single_that_the_next_one_needs_a_jump_and_the_flash_cost_more():
    text = "\n".join([
        "     10:\tee30 0a01 \tvadd.f32\ts0, s0, s2",
        "     14:\tee30 1a00 \tvadd.f32\ts2, s0, s0",
        "     18:\tee30 2a04 \tvadd.f32\ts4, s6, s8",
        "     1c:\ted9f 0a01 \tvldr\ts0, [pc, #4]",
        "     20:\te7f6      \tb.n\t10 <x>",
    ])  # fmt: skip
    code = dict(cycles._instructions(text))
    assert [code[a].size for a in (0x10, 0x20)] == [4, 2]
    assert cycles._cost(code, 0x10, 0x14, 0x18) == (2, 0)  # waits for s0
    assert cycles._cost(code, 0x14, 0x18, 0x1C) == (1, 0)
    assert cycles._cost(code, 0x18, 0x1C, 0x20) == (2, 3)  # a constant from the flash
    assert cycles._cost(code, 0x1C, 0x20, 0x10) == (3, 3)  # a jump, and a line of its own
    assert cycles._cost(code, 0x20, 0x10, 0x14) == (1, 3)


def test_bits_are_the_same_or_no_number_both():
    a = np.array([0.0, np.nan, 1.0, np.nan], np.float32)
    b = np.array([-0.0, -np.nan, 1.0, 1.0], np.float32)
    assert measure.same_bits(a, b).tolist() == [False, True, True, False]


def test_a_faulty_log_begins_whole_and_loses_some():
    spoilt = measure.faulty(SocSample(np.ones(100_000), np.ones(100_000), 3.7, 25.0))
    assert spoilt.dt_s[0] == spoilt.current_A[0] == 1.0 and spoilt.voltage_V == 3.7
    assert np.isnan(spoilt.current_A).mean() == pytest.approx(measure.MISSING, rel=0.2)


def test_the_page_has_every_filter():
    text = measure.PAGE.read_text(encoding="utf-8")
    for name, options in measure.FILTERS:
        assert f"| {measure.title_of(name, **options)} | -O2 |" in text
    for robot, name, _ in measure.OBSERVERS:
        assert f"| {robot.name} speed, {name} | -Os |" in text
    for name in measure.CONTROLLERS:
        assert f"| RLMA {name} | -O2 |" in text
