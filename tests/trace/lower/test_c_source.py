"""The C of a step, compiled and run on this machine, against machine code in single precision: the same bits."""

import ctypes
import re
import subprocess
from typing import Any, NamedTuple

import every_operation
import numpy as np
import pytest
from every_operation import Memory, Seen

from filters import saft_seven_states
from needs import needs_gcc
from ohmward.errors import InputError
from ohmward.trace import clip, exp, maximum, minimum, single_precision, table, trace, where
from ohmward.trace.lower.c_operations import constant_arrays, literal
from ohmward.trace.lower.c_source import c_source, members
from ohmward.trace.lower.llvm_run import MachineStep
from ohmward.trace.structure import size, structure_of

pytest.importorskip("llvmlite")
RNG = np.random.default_rng(3)
STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wdouble-promotion", "-Wconversion", "-Werror", "-O2"]
STRICT += ["-ffp-contract=off", "-fno-math-errno"]


def compiled(source, name, folder):
    """The C as a function of arrays of bytes."""
    (folder / f"{name}.h").write_text(source.header)
    (folder / f"{name}.c").write_text(source.source)
    library = folder / f"{name}.so"
    command = ["gcc", *STRICT, "-shared", "-fPIC", "-o", library, folder / f"{name}.c", "-lm"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return getattr(ctypes.CDLL(str(library)), f"{name}_step")


def struct_of(structure):
    kinds = {"float": np.float32, "bool": np.bool_}
    fields = [(m.name, kinds[m.kind], (m.size,)) if m.size else (m.name, kinds[m.kind]) for m in members(structure)]
    return np.zeros(1, np.dtype(fields, align=True))


def fill(struct, scalars):
    rest = iter(scalars)
    for name in struct.dtype.names:
        for place in np.ndindex(struct[name].shape):
            struct[name][place] = next(rest)


def run_c(program, step, start, columns):
    """Outputs (T, n) of the compiled C."""
    before, sample = program.argument_structure.children
    structs = [struct_of(s) for s in (before, sample, program.result_structure.children[1])]
    fill(structs[0], start)
    rows = []
    for row in zip(*columns, strict=True):
        fill(structs[1], row)
        step(*(s.ctypes.data_as(ctypes.c_void_p) for s in structs))
        rows.append(np.concatenate([np.ravel(structs[2][n]).astype(float) for n in structs[2].dtype.names]))
    return np.array(rows)


def run_llvm(program, start, columns):
    count = size(program.argument_structure.children[0])
    state, outputs = np.array(start, float), np.empty((len(program.outputs) - count, len(columns[0])))
    MachineStep(program, count, "f32", contract=False).one(
        state, [np.asarray(c, float) for c in columns], list(outputs), None
    )
    return outputs.T


@needs_gcc
def test_every_operation_has_the_bits_of_machine_code(tmp_path):
    program = trace(every_operation.step, Memory(0.0, False, np.zeros(2)), Seen(0.0, False, 0.0))
    u, w = RNG.normal(0.0, 2.0, (2, 400)).astype(np.float32).astype(float)
    u[::37], w[::41] = np.nan, np.inf
    columns, start = [u, RNG.random(400) < 0.5, w], [0.3, 0.0, 0.1, -0.2]
    in_c = run_c(program, compiled(c_source(program, "all_of_it"), "all_of_it", tmp_path), start, columns)
    np.testing.assert_array_equal(in_c, run_llvm(program, start, columns))


@needs_gcc
def test_a_whole_filter_has_the_bits_of_machine_code(tmp_path):
    start = saft_seven_states.PACKED
    program = trace(saft_seven_states.packed_step, start, (0.0, 0.0))
    flat = np.concatenate([np.ravel(x) for x in start]).astype(float)
    columns = [column.astype(np.float32).astype(float) for column in saft_seven_states.simulated_log(300)]
    in_c = run_c(program, compiled(c_source(program, "aukf"), "aukf", tmp_path), flat, columns)
    np.testing.assert_array_equal(in_c, run_llvm(program, flat, columns))


def test_the_header_names_members_and_carries_comments():
    program = trace(every_operation.step, Memory(0.0, False, np.zeros(2)), Seen(0.0, False, 0.0))
    header = c_source(program, "cell", comments={"sample.u": "pull [m/s]"}).header
    assert "    float held[2];\n} cell_state;" in header
    assert "    float u; /* pull [m/s] */\n    bool on;" in header
    assert "void cell_step(cell_state *state, const cell_sample *sample, cell_output *output);" in header


def test_members_that_would_collide_get_names_of_their_own():
    class Twice(NamedTuple):
        a_b: Any
        a: Any

    class Inner(NamedTuple):
        b: Any

    names = [m.name for m in members(structure_of(Twice(0.0, Inner(np.zeros(3))), ""))]
    assert names == ["a_b", "a_b_"]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.0, "1.0f"),
        (-0.1, "(-0.1f)"),
        (1e-9, "1e-09f"),
        (16777216.0, "1.6777216e+07f"),
        (1e300, "INFINITY"),
        (True, "true"),
    ],
)
def test_literals_are_singles(value, text):
    assert literal(value) == text
    if text[0].isdigit():
        assert np.float32(float(text.rstrip("f"))) == np.float32(value)


@pytest.mark.parametrize("name", ["", "Step", "2nd", "a-b", "step()"])
def test_a_prefix_must_be_a_word(name):
    program = trace(lambda s, x: (s + x, s), 0.0, 0.0)
    with pytest.raises(InputError, match="name must be small letters"):
        c_source(program, name)


def test_a_function_that_is_no_step_is_refused():
    with pytest.raises(InputError, match=r"step\(state, sample\) -> \(state, output\)"):
        c_source(trace(lambda x: x + 1.0, 0.0), "f")


def opened(first: Seen, level, spread):
    """A start: it looks at the first sample."""
    return Memory(where(first.on, level, 0.5 * first.u), first.w > spread, np.array([exp(spread), 1.0]))


@needs_gcc
def test_a_start_stands_beside_its_step(tmp_path):
    step = trace(every_operation.step, Memory(0.0, False, np.zeros(2)), Seen(0.0, False, 0.0))
    start = trace(opened, Seen(0.0, False, 0.0), 0.0, 0.0)
    source = c_source(step, "cell", start)
    assert "void cell_start(cell_state *state, const cell_sample *sample, float level, float spread);" in source.header
    compiled(source, "cell", tmp_path)
    function = ctypes.CDLL(str(tmp_path / "cell.so")).cell_start
    function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_float, ctypes.c_float]
    state, sample = struct_of(step.argument_structure.children[0]), struct_of(step.argument_structure.children[1])
    fill(sample, (3.0, False, 1.0))
    function(state.ctypes.data, sample.ctypes.data, 0.25, 0.5)
    assert state["level"][0] == 1.5 and state["armed"][0]
    assert state["held"][0, 0] == pytest.approx(np.exp(0.5), rel=1e-6)


def test_a_start_of_another_form_is_refused():
    step = trace(lambda s, x: (s + x, s), 0.0, 0.0)
    with pytest.raises(InputError, match=r"start\(sample, number, ...\) -> state"):
        c_source(step, "f", trace(lambda x: (x, x), 0.0))


def bounded(state, x):
    """Extrema and tables in every form that has a shorter C: bounds that are numbers, and indices that are in range."""
    low, high = maximum(x, 0.25), minimum(x, 0.25)
    turned = maximum(-0.5, high), minimum(0.5, low)
    curves = table(CURVE, -1.0, 0.5, x), table(CURVE, -1.0, 0.5, x, "hermite"), table(CURVE[1:], -0.5, 0.5, low)
    flat, lines = table((2.0, 2.0, 2.0), 0.0, 1.0, x, "hermite"), table(BENT, -1.0, 0.1, x)
    return state, (low, high, *turned, clip(x, 0.0, 1.0), minimum(x, maximum(x, -x)), *curves, flat, lines)


CURVE = (3.0, 3.4, 3.5, 3.45, 4.0)
#: Values on three lines.
BENT = (*np.linspace(1.0, 2.0, 9), *np.linspace(2.5, 2.5, 5), *np.linspace(2.0, -1.0, 12))


@needs_gcc
def test_shorter_forms_have_the_bits_of_the_long_ones(tmp_path):
    program = trace(bounded, 0.0, 0.0)
    x = np.array([*np.linspace(-2.0, 2.0, 81), 0.25, -0.25, 0.0, -0.0, np.nan, np.inf, -np.inf, 3e38, -3e38, 1e9, -1e9])
    x = x.astype(np.float32)
    source = c_source(program, "short")
    in_c = run_c(program, compiled(source, "short", tmp_path), [0.0], [x])
    _, in_numpy = single_precision.run(program, np.zeros(1), x[:, None])
    np.testing.assert_array_equal(in_c, in_numpy)
    np.testing.assert_array_equal(np.signbit(in_c), np.signbit(in_numpy))
    assert source.source.count("!=") == 2  # of the one minimum whose both arguments may be nan
    assert "uint8_t short_table" in source.source
    assert "short_index" not in source.source and "short_floor" not in source.source


def test_tables_that_overlap_share_an_array():
    program = trace(lambda s, x: (s, (table(CURVE, 0.0, 1.0, x), table(CURVE, 0.0, 1.0, x + 1.0))), 0.0, 0.0)
    assert constant_arrays([program, program]) == [(2.6, *CURVE, 4.55)]


def test_a_flat_table_is_a_number():
    program = trace(lambda x: table((2.0, 2.0, 2.0), 0.0, 1.0, x, "hermite"), 0.0)
    assert program.outputs == (2.0,) and not program.nodes


def filtered(state, sample):
    """A first-order filter: the usual one."""
    share = 1.0 - exp(-sample.w)
    level = state + share * (sample.u - state)
    return level, (level * 2.0, level > sample.w)


def test_the_text_has_the_names_and_functions_of_the_traced_code():
    source = c_source(trace(filtered, 0.0, Seen(0.0, False, 0.0), with_origins=True), "low").source
    assert "    /* filtered (test_c_source.py): A first-order filter */\n" in source
    assert re.search(
        r"const float share = 1\.0f - .*;\n    const float level = value \+ \(u - value\) \* share;", source
    )
    assert "    state->value = level;\n    output->x0 = 2.0f * level;\n    output->x1 = w < level;\n" in source


def test_words_of_c_are_no_names():
    def step(state, sample):
        """A step."""
        double = sample * 2.0
        gamma = double + 1.0
        return double * gamma, gamma

    source = c_source(trace(step, 0.0, 0.0, with_origins=True), "words").source
    assert "const float double2 = " in source and "const float gamma2 = " in source


def test_brackets_stand_where_another_order_would_have_other_bits():
    def step(state, x):
        return state, (state - (x - 1.0), state * (x / 3.0), state / (x * 3.0), -(state + x), (state + x) * x)

    text = c_source(trace(step, 0.0, 0.0), "order").source
    for formula in ("value - (value2 - 1.0f)", "value * (value2 / 3.0f)", "value / (3.0f * value2)"):
        assert formula in text
