"""The twin: the exported C on this machine, with the bits of two independent runs of the same program."""

import math
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from embedded.batteries import soc_export, soc_library
from needs import needs_gcc
from ohmward.battery.soc.sample import SocSample
from ohmward.embedded import Twin, controller_export, library, observer_export, twin, write_library
from ohmward.embedded.comparison import compare, in_double_precision
from ohmward.embedded.twin import FLAGS
from ohmward.errors import InputError, OhmwardError
from ohmward.trace import single_precision
from ohmward.trace.structure import size
from ohmward.traction import RLMA, hard_terrain
from ohmward.traction.control import Measurement, SlipCommand

pytest.importorskip("cffi", reason="pip install cffi for the twin")
pytestmark = needs_gcc
FIRST = SocSample(0.0, -1.0, 13.2, 25.0)


def made(export, folder):
    write_library(library(export), folder)
    return Twin(folder)


def a_log(steps):
    """(steps, 4) of a drive with faults of every sensor, in singles."""
    rng = np.random.default_rng(4)
    current = rng.normal(-2.0, 3.0, steps)
    log = np.stack([np.ones(steps), current, 13.1 + 0.02 * current, np.full(steps, 20.0)], axis=1)
    for column, value in enumerate((math.nan, math.nan, math.inf, -300.0)):
        log[rng.random(steps) < 0.02, column] = value
    return log.astype(np.float32).astype(float)


def rows(outputs):
    """(T, k) of outputs, conditions as 0 and 1."""
    return np.concatenate([np.asarray(x, np.float32).reshape(len(x), -1) for x in outputs], axis=1)


@pytest.mark.parametrize("name", ["coulomb", "textbook-ekf", "ekf"])
def test_a_log_has_the_bits_of_numpy_singles_and_of_machine_code(name, tmp_path):
    run = pytest.importorskip("ohmward.trace.lower.llvm_run")
    export, log = soc_export(name), a_log(60)
    copy = made(export, tmp_path)
    copy.start(SocSample(*log[0]), **dict(zip(copy.arguments, (0.7, 0.1), strict=False)))
    state = np.concatenate([np.ravel(part) for part in copy.state])
    found = rows(copy.run(SocSample(*log.T)))

    _, numpy_rows = single_precision.run(export.step, state, log)
    np.testing.assert_array_equal(found, numpy_rows)
    machine, columns = np.array(state, float), np.empty((found.shape[1], len(log)))
    step = run.MachineStep(export.step, state.size, "f32", contract=False)
    step.one(machine, list(np.ascontiguousarray(log.T)), list(columns), None)
    np.testing.assert_array_equal(found, columns.T.astype(np.float32))


@pytest.mark.usefixtures("quickly_compiled")
@pytest.mark.parametrize("soc", [0.25, math.nan])
def test_the_start_is_that_of_the_program(soc, tmp_path):
    export = soc_export("ekf")
    copy = made(export, tmp_path)
    copy.start(FIRST, soc=soc, soc_std=0.5)
    inputs = np.array([*FIRST, soc, 0.5], np.float32)
    expected = single_precision.evaluator(export.start)(inputs)
    np.testing.assert_array_equal(np.concatenate([np.ravel(x) for x in copy.state]).astype(np.float32), expected)


def test_live_samples_and_a_whole_log_are_the_same(tmp_path):
    live, whole = (made(soc_export("textbook-ekf"), tmp_path) for _ in range(2))
    log = a_log(40)
    for copy in (live, whole):
        copy.start(FIRST, soc=0.5, soc_std=0.3)
    one_by_one = np.array([live.step(SocSample(*row)) for row in log], np.float32)
    np.testing.assert_array_equal(one_by_one, rows(whole.run(SocSample(*log.T))))
    np.testing.assert_equal(live.state, whole.state)
    halves = made(soc_export("textbook-ekf"), tmp_path)
    halves.start(FIRST, soc=0.5, soc_std=0.3)
    pair = [rows(halves.run(SocSample(*part.T))) for part in (log[:13], log[13:])]
    np.testing.assert_array_equal(one_by_one, np.concatenate(pair))


@pytest.mark.usefixtures("quickly_compiled")
def test_the_vectors_of_a_robot_pass_with_arrays_in_sample_and_output(tmp_path):
    export = observer_export(RLMA, hard_terrain("dry asphalt"), "ekf", "speed")
    copy, samples = made(export, tmp_path), export.samples.astype(np.float32)
    columns = (samples[:, 0], samples[:, 1:5], samples[:, 5:7], *samples[:, 7:].T)
    copy.start(copy.Sample(*(column[0] for column in columns)))
    found = copy.run(columns)
    assert found.slip_ratio.shape == (64, 2) and found.speed_m_s.shape == (64,)
    start = single_precision.evaluator(export.start)(samples[0])
    np.testing.assert_array_equal(rows(found), single_precision.run(export.step, start, samples)[1])


def test_nested_samples_are_those_of_the_controller(tmp_path):
    copy = made(controller_export(RLMA, "slip-controller", "wheel"), tmp_path)
    sample = (SlipCommand(0.12, 1.0), Measurement(5.0, 0.4), 0.001)
    copy.start(sample)
    nested = copy.step(sample)
    copy.start(copy.Sample(*sample[0], *sample[1], 0.001))
    assert nested == copy.step(copy.Sample(*sample[0], *sample[1], 0.001))
    assert nested.torque_Nm != 0.0


def test_flags_and_members_are_those_of_the_header(tmp_path):
    copy = made(soc_export("coulomb"), tmp_path)
    assert copy.name == "soc" and copy.arguments == () and copy.Sample._fields == SocSample._fields
    assert copy.example == {}
    assert copy.flags["NO_CURRENT"] == 1 and copy.flags["DIVERGED"] == 256
    assert copy.dtype("sample").itemsize == 16
    copy.start(FIRST)
    assert copy.step(FIRST._replace(current_A=math.nan)).flags == copy.flags["NO_CURRENT"]


def test_the_example_is_what_it_was_exported_with(tmp_path):
    copy = made(soc_export("textbook-ekf", soc=0.625, soc_std=1e-05), tmp_path)
    assert copy.example == {"soc": 0.625, "soc_std": 1e-05}


@pytest.mark.usefixtures("quickly_compiled")
def test_double_precision_is_near_and_a_wrong_library_is_far(tmp_path):
    export = soc_export("ekf")
    log = a_log(300)
    samples, start = SocSample(*log.T), {"soc": 0.5, "soc_std": 0.3}
    copy = made(export, tmp_path)
    copy.start(SocSample(*log[0]), **start)
    found = copy.run(samples)
    largest = compare(copy, export, found, samples, tuple(start.values()))
    assert set(largest) == set(found._fields) and largest["soc"] < 2e-4 and largest["flags"] == 0.0
    assert largest["soc"] == np.abs(in_double_precision(export, samples, (0.5, 0.3)).soc - found.soc).max() > 0.0
    worse = found._replace(soc=found.soc + np.float32(0.01), voltage_V=np.full(300, np.nan, np.float32))
    told = compare(copy, export, worse, samples, (0.5, 0.3))
    assert told["soc"] > 0.009 and told["voltage_V"] == math.inf


def test_double_precision_needs_no_machine_code(monkeypatch):
    from ohmward.embedded import comparison
    from ohmward.trace.lower.llvm_machine_code import NoMachineCodeError

    def none(*_):
        raise NoMachineCodeError("none")

    export, samples = soc_export("textbook-ekf"), SocSample(*a_log(50).T)
    fast = in_double_precision(export, samples, (0.5, 0.3))
    monkeypatch.setattr(comparison, "run_log", none)
    np.testing.assert_allclose(in_double_precision(export, samples, (0.5, 0.3)).soc, fast.soc, rtol=1e-9)


def test_another_estimators_library_is_not_compared(tmp_path):
    copy = made(soc_export("textbook-ekf"), tmp_path)
    samples = SocSample(*a_log(5).T)
    copy.start(FIRST, soc=0.5, soc_std=0.3)
    with pytest.raises(InputError, match=r"is not .*extended Kalman filter.*--filter"):
        compare(copy, soc_export("ekf"), copy.run(samples), samples, (0.5, 0.3))


def test_what_a_caller_does_wrong_is_said(tmp_path):
    copy = made(soc_export("textbook-ekf"), tmp_path)
    with pytest.raises(InputError, match="call start"):
        copy.step(FIRST)
    with pytest.raises(InputError, match=r"takes the sample and soc=\.\.\., soc_std=\.\.\.; got soc"):
        copy.start(FIRST, soc=0.5)
    copy.start(FIRST, soc=0.5, soc_std=0.3)
    with pytest.raises(InputError, match="members dt_s, current_A, voltage_V, temperature_degC; got 3 values"):
        copy.step((1.0, 2.0, 3.0))
    with pytest.raises(InputError, match="differ in length"):
        copy.run((np.ones(3), np.ones(4), 13.0, 25.0))
    with pytest.raises(InputError, match=r"current_A has the shape \(\)"):
        copy.run((np.ones(3), np.ones((3, 2)), 13.0, 25.0))
    with pytest.raises(InputError, match="voltage_V must hold numbers"):
        copy.step((1.0, 2.0, "three", 25.0))


def test_a_folder_without_a_library_or_with_two_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"no exported library.*ohmward export"):
        Twin(tmp_path)
    for name in ("a", "b"):
        write_library(soc_library("coulomb", name), tmp_path)
    with pytest.raises(InputError, match="several libraries, a, b; name one"):
        Twin(tmp_path)
    assert Twin(tmp_path, "b").name == "b"
    with pytest.raises(InputError, match="no exported library 'c'"):
        Twin(tmp_path, "c")


def test_a_library_that_does_not_compile_says_what_the_compiler_says(tmp_path):
    files = dict(soc_library("coulomb"))
    files["soc.c"] = files["soc.c"].replace("->soc", "->sock", 1)
    write_library(files, tmp_path)
    with pytest.raises(OhmwardError, match=r"(?s)the C compiler refuses.*sock"):
        Twin(tmp_path)


def test_without_a_compiler_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(OhmwardError, match="apt-get install gcc"):
        twin.compiler()


def test_the_compiler_is_that_of_the_environment_with_its_words(monkeypatch):
    monkeypatch.setenv("CC", "gcc -m64")
    assert twin.compiler() == ["gcc", "-m64"]
    monkeypatch.setenv("CC", "no-such-compiler")
    assert shutil.which(twin.compiler()[0])


def test_without_cffi_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cffi", None)
    with pytest.raises(OhmwardError, match="needs cffi, which is not installed: pip install cffi"):
        made(soc_export("coulomb"), tmp_path)


def test_the_makefile_of_the_library_compiles_the_same_arithmetic():
    files = dict(soc_library("coulomb"))
    for flag in FLAGS:
        assert flag in files["Makefile"]
        assert flag in files["CMakeLists.txt"] or not flag.startswith("-f")


@pytest.mark.usefixtures("quickly_compiled")
def test_structs_have_as_many_numbers_as_the_program(tmp_path):
    export = soc_export("ekf")
    copy = made(export, tmp_path)
    state, sample = export.step.argument_structure.children
    assert copy.dtype("state").itemsize == 4 * size(state) and copy.dtype("sample").itemsize == 4 * size(sample)


def test_the_program_of_the_page_runs(tmp_path, monkeypatch):
    page = (Path(__file__).parents[2] / "docs" / "export.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"^```\{code-block\} python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(compile(program, "docs/export.md", "exec"), names)
    assert 0.0 < names["soc"] < 1.0 and names["one"].soc == pytest.approx(0.5, abs=0.1)
