"""Test vectors: samples, and the bits that the outputs must have after each of them."""

from __future__ import annotations

import numpy as np

from ohmward.trace import single_precision
from ohmward.trace.lower.c_source import members
from ohmward.trace.program import Program
from ohmward.trace.structure import Structure


def vectors_header(name: str, step: Program, start: Program, arguments: tuple[float, ...], samples: np.ndarray) -> str:
    """A C header with samples (T, m) and the outputs (T, k) that follow from them, and how to fill and compare.

    arguments: of the start, after the sample.
    """
    singles = np.asarray(samples, np.float32)
    first = np.concatenate([singles[0], np.array(arguments, np.float32)])
    state = single_precision.evaluate(single_precision.expanded(start), first)
    _, outputs = single_precision.run(step, state, singles)
    sample, output = step.argument_structure.children[1], step.result_structure.children[1]  # type: ignore[union-attr]
    reads = [f"    sample->{place} = {_from_bits(kind)};" for place, kind in _scalars(sample)]
    same = [f"    same = same && {_equal(place, kind)};" for place, kind in _scalars(output)]
    return "\n".join([
        f"/* Bits of the samples and of the outputs that {name}_step must give for them, one after the other. */",
        "#include <stdbool.h>",
        "#include <stdint.h>",
        "#include <string.h>",
        "",
        f"#define {name.upper()}_VECTORS {len(singles)}",
        "",
        _array(f"{name}_samples", singles),
        _array(f"{name}_outputs", outputs),
        "static inline float from_bits(uint32_t bits)",
        "{",
        "    float number;",
        "    memcpy(&number, &bits, sizeof number);",
        "    return number;",
        "}",
        "",
        "/* The same bits, or no number both. */",
        "static inline bool is(float found, uint32_t bits)",
        "{",
        "    uint32_t own;",
        "    memcpy(&own, &found, sizeof own);",
        "    return own == bits || (found != found && from_bits(bits) != from_bits(bits));",
        "}",
        "",
        f"static inline void {name}_vector(unsigned t, {name}_sample *sample)",
        "{",
        f"    const uint32_t *bits = {name}_samples[t];",
        *reads,
        "}",
        "",
        f"static inline bool {name}_is_right(unsigned t, const {name}_output *output)",
        "{",
        f"    const uint32_t *bits = {name}_outputs[t];",
        "    bool same = true;",
        *same,
        "    return same;",
        "}",
        "",
    ])  # fmt: skip


def _scalars(structure: Structure) -> list[tuple[str, str]]:
    return [(place, member.kind) for member in members(structure) for place in member.places]


def _from_bits(kind: str) -> str:
    return "*bits++ != 0u" if kind == "bool" else "from_bits(*bits++)"


def _equal(place: str, kind: str) -> str:
    return f"output->{place} == (*bits++ != 0u)" if kind == "bool" else f"is(output->{place}, *bits++)"


def _array(name: str, values: np.ndarray) -> str:
    """Rows of numbers as their bits; nan is nan, whatever its sign."""
    bits = np.where(np.isnan(values), np.float32(np.nan), values).astype(np.float32).view(np.uint32)
    rows = [f"    {{{', '.join(f'0x{b:08X}u' for b in row)}}}," for row in bits]
    return "\n".join([f"static const uint32_t {name}[{len(bits)}][{bits.shape[1]}] = {{", *rows, "};", ""])
