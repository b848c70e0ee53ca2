"""Test vectors: samples, and the bits that the outputs must have after each of them."""

from __future__ import annotations

import numpy as np

from ohmward.trace import single_precision
from ohmward.trace.lower.c_source import members
from ohmward.trace.program import Program
from ohmward.trace.structure import Structure


def vector_words(step: Program, start: Program, arguments: tuple[float, ...], samples: np.ndarray) -> dict[str, str]:
    """Words of templates/NAME_vectors.h.in: samples (T, m), the outputs (T, k) after them, filling and comparing.

    arguments: of the start, after the sample.
    """
    singles = np.asarray(samples, np.float32)
    first = np.concatenate([singles[0], np.array(arguments, np.float32)])
    state = single_precision.evaluate(single_precision.expanded(start), first)
    _, outputs = single_precision.run(step, state, singles)
    sample, output = step.step_structure.sample, step.step_structure.output
    return {
        "VECTORS": str(len(singles)),
        "SAMPLE_BITS": _array_of_bits(singles),
        "OUTPUT_BITS": _array_of_bits(outputs),
        "FILL_SAMPLE": "\n".join(f"    sample->{place} = {_from_bits(kind)};" for place, kind in scalars(sample)),
        "COMPARE_OUTPUT": "\n".join(
            f"    same = same && {_same_bits(place, kind)};" for place, kind in scalars(output)
        ),
    }


def scalars(structure: Structure) -> list[tuple[str, str]]:
    """Place in the struct and kind, "float" or "bool", of every scalar."""
    return [(place, member.kind) for member in members(structure) for place in member.places]


def _from_bits(kind: str) -> str:
    return "*bits++ != 0u" if kind == "bool" else "from_bits(*bits++)"


def _same_bits(place: str, kind: str) -> str:
    return f"output->{place} == (*bits++ != 0u)" if kind == "bool" else f"is(output->{place}, *bits++)"


def _array_of_bits(values: np.ndarray) -> str:
    """Size and rows of an array of numbers as their bits; nan is nan, whatever its sign."""
    bits = np.where(np.isnan(values), np.float32(np.nan), values).astype(np.float32).view(np.uint32)
    rows = [f"    {{{', '.join(f'0x{b:08X}u' for b in row)}}}," for row in bits]
    return "\n".join([f"[{len(bits)}][{bits.shape[1]}] = {{", *rows, "}"])
