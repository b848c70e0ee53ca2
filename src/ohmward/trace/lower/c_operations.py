"""Operations in C99 and single precision, with the helpers that some of them need."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ohmward.trace.bounds import bounds, within
from ohmward.trace.expression import Expression
from ohmward.trace.program import Program


def constant_arrays(programs: Iterable[Program]) -> list[tuple[float, ...]]:
    """The arrays that hold every table of the programs: first those of floats, then those of bytes.

    No array is part of another one, and none continues another one by a single value.
    """
    gathers = [node for program in programs for node in program.nodes if node.operation.name == "gather"]
    tables = sorted(dict.fromkeys(node.args[1] for node in gathers), key=len, reverse=True)
    of_floats = [table for table in tables if not are_bytes(table)]
    of_bytes = [table for table in tables if are_bytes(table)]
    return [*_joined(of_floats), *_joined(of_bytes)]


def are_bytes(values: tuple[float, ...]) -> bool:
    """True where all values are whole numbers from 0 to 255: such a table is stored in bytes."""
    return all(0.0 <= v <= 255.0 and v.is_integer() for v in values)


def _joined(tables: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
    """Arrays that hold tables, the longest of which come first."""
    arrays: list[tuple[float, ...]] = []
    for values in tables:
        if any(position(values, array) is not None for array in arrays):
            continue
        *continued, last = values
        for k, array in enumerate(arrays):
            if array[-len(continued) :] == tuple(continued):
                arrays[k] += (last,)
                break
        else:
            arrays.append(values)
    return arrays


def position(values: tuple[float, ...], array: tuple[float, ...]) -> int | None:
    """Index from which an array holds the values; None if it does not."""
    for k in range(len(array) - len(values) + 1):
        if array[k] == values[0] and array[k : k + len(values)] == values:
            return k
    return None


#: Up to this size every whole number is exact in single precision, so a cast to an integer gives the same as `floor`.
_LARGEST_WHOLE_SINGLE = 2.0**23


def is_whole(node: Expression) -> bool:
    """True where an integer can hold the value: an entry of a table of bytes, or the floor of a small number >= 0."""
    if node.operation.name == "gather":
        return are_bytes(node.args[1])
    return node.operation.name == "floor" and within(node, 0.0, _LARGEST_WHOLE_SINGLE)


def template(node: Expression) -> Template:
    """C of an operation; a shorter one where an argument of an extremum cannot be nan."""
    name = node.operation.name
    if name in ("minimum", "maximum"):
        if bounds(node.args[1]):
            return _TEMPLATES[f"{name} with a number"]
        if bounds(node.args[0]):
            return _TEMPLATES[f"{name} of a number"]
    return _TEMPLATES[name]


def literal(value: object) -> str:
    """Number or condition in C, with the digits that a single needs."""
    if isinstance(value, bool):
        return "true" if value else "false"
    with np.errstate(over="ignore"):
        single = np.float32(value)  # type: ignore[arg-type]
    if np.isnan(single):
        return "NAN"
    if np.isinf(single):
        return "INFINITY" if single > 0 else "-INFINITY"
    digits = np.format_float_scientific(single, unique=True, trim="-")
    digits = (
        np.format_float_positional(single, unique=True, trim="0")
        if 1e-4 <= abs(single) < 1e7 or single == 0
        else digits
    )
    digits = digits if any(c in digits for c in ".e") else f"{digits}.0"
    return f"({digits}f)" if single < 0 or (single == 0 and np.signbit(single)) else f"{digits}f"


#: Ranks of operators, the tightest first. MISRA C 12.1 requires brackets around all but sums and products.
ATOM, UNARY, PRODUCT, SUM, LOOSE = range(5)


class Formula(NamedTuple):
    """C of a value, and the rank of its outermost operator."""

    text: str
    rank: int


class Template(NamedTuple):
    """C of an operation, {0} its first argument."""

    text: str
    rank: int = ATOM
    #: for each argument, the loosest operator that it may have without brackets
    most: tuple[int, ...] = (LOOSE, LOOSE, LOOSE)


_COMPARED, _CHOSEN = (SUM, SUM), (ATOM, SUM, SUM)
_TEMPLATES: dict[str, Template] = {
    "add": Template("{0} + {1}", SUM, (SUM, PRODUCT)),
    "subtract": Template("{0} - {1}", SUM, (SUM, PRODUCT)),
    "multiply": Template("{0} * {1}", PRODUCT, (PRODUCT, UNARY)),
    "divide": Template("{0} / {1}", PRODUCT, (PRODUCT, UNARY)),
    "negative": Template("-{0}", UNARY, (ATOM,)),
    "remainder": Template("{0} - {name}_floor({0} / {1}) * {1}", SUM, (ATOM, ATOM)),
    "floor_divide": Template("{name}_floor({0} / {1})", ATOM, (PRODUCT, UNARY)),
    "absolute": Template("fabsf({0})"),
    "sqrt": Template("sqrtf({0})"),
    "floor": Template("{name}_floor({0})"),
    "minimum": Template("({0} < {1} || {0} != {0}) ? {0} : {1}", LOOSE, _COMPARED),
    "maximum": Template("({0} > {1} || {0} != {0}) ? {0} : {1}", LOOSE, _COMPARED),
    "minimum of a number": Template("({0} < {1}) ? {0} : {1}", LOOSE, _COMPARED),
    "maximum of a number": Template("({0} > {1}) ? {0} : {1}", LOOSE, _COMPARED),
    "minimum with a number": Template("({0} >= {1}) ? {1} : {0}", LOOSE, _COMPARED),
    "maximum with a number": Template("({0} <= {1}) ? {1} : {0}", LOOSE, _COMPARED),
    "where": Template("{0} ? {1} : {2}", LOOSE, _CHOSEN),
    "sign": Template("({0} > 0.0f) ? 1.0f : ({0} < 0.0f) ? -1.0f : ({0} == 0.0f) ? 0.0f : {0}", LOOSE, (SUM,)),
    "power_of_two": Template("{name}_power_of_two({0})"),
    "exponent": Template("{name}_exponent({0})"),
    "less": Template("{0} < {1}", LOOSE, _COMPARED),
    "less_equal": Template("{0} <= {1}", LOOSE, _COMPARED),
    "equal": Template("{0} == {1}", LOOSE, _COMPARED),
    "not_equal": Template("{0} != {1}", LOOSE, _COMPARED),
    "logical_and": Template("{0} && {1}", LOOSE, (ATOM, ATOM)),
    "logical_or": Template("{0} || {1}", LOOSE, (ATOM, ATOM)),
    "logical_not": Template("!{0}", UNARY, (ATOM,)),
    "isfinite": Template("fabsf({0}) < INFINITY", LOOSE),
}

_KEYWORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while bool true false asm
class new delete this
"""
_FUNCTIONS = """
abs acos asin atan ceil cos cosh cbrt div erf exp exp2 expm1 fabs fdim floor fma fmax fmin fmod frexp gamma hypot index
j0 j1 jn ldexp lgamma log log10 log1p log2 logb main memcpy memset modf nan pow remainder remquo rint round sin sinh
sqrt tan tanh tgamma time trunc y0 y1 yn
"""
#: Words that cannot be the name of a local variable, or that it would hide.
NO_NAMES = frozenset((_KEYWORDS + _FUNCTIONS).split())


def comment_text(text: str) -> str:
    """Text made safe for a comment in C."""
    return text.replace("*/", "* /").replace("/*", "/ *")


#: Functions that a file gets when it needs them; NAME is its prefix.
HELPERS = {
    "power_of_two": """\
/* 2^n for a whole n from -126 to 127: the sum has n + 127 in its lowest bits. */
static inline float NAME_power_of_two(float n)
{
    const float lifted = n + 12583039.0f;
    uint32_t bits;
    float result;
    (void)memcpy(&bits, &lifted, sizeof bits);
    bits <<= 23;
    (void)memcpy(&result, &bits, sizeof result);
    return result;
}
""",
    "exponent": """\
/* The exponent of a normal x > 0. */
static inline float NAME_exponent(float x)
{
    uint32_t bits;
    float result;
    (void)memcpy(&bits, &x, sizeof bits);
    bits = (bits >> 23) | 0x4B000000u;
    (void)memcpy(&result, &bits, sizeof result);
    return result - 8388735.0f;
}
""",
    "floor": """\
/* The largest whole number that is not above x. */
static inline float NAME_floor(float x)
{
    if (!(fabsf(x) < 8388608.0f)) {
        return x;
    }
    const float cut = (float)(int32_t)x;
    return cut > x ? cut - 1.0f : cut;
}
""",
    "index": """\
/* A place in a table; beyond its ends the last one there, the first for no number. */
static inline int32_t NAME_index(float x, int32_t count)
{
    if (!(x > 0.0f)) {
        return 0;
    }
    return x < (float)(count - 1) ? (int32_t)x : count - 1;
}
""",
}
