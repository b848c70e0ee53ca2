"""Exact Jacobians by forward differentiation of the graph."""

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.trace.expression import Expression, Scalar, apply, next_serial, number, symbol
from ohmward.trace.origins import recorder
from ohmward.trace.program import run_traced, schedule


def linearize(f: Callable[[np.ndarray], Any], x: Any) -> tuple[np.ndarray, np.ndarray]:
    """Value and Jacobian of f at x.

    f:  (n,) -> (m,), written for tracing; traced values that it closes over are constants here.
    x:  (n,) floats, or traced scalars, or both.
    Returns: f(x) (m,) and df/dx (m, n), of floats if all values are, else object arrays. An output that does not depend
             on x_j has the literal 0.0 in column j.
    Raises:  InputError when x or f(x) is not one row of numbers.
    """
    at = np.asarray(x)
    if at.ndim != 1:
        raise InputError(f"linearize: x must be one row of numbers (n,), got shape {at.shape}")
    inputs = [symbol(f"x[{i}]") for i in range(at.size)]
    rows = np.asarray(run_traced(f, np.array(inputs, dtype=object)))
    if rows.ndim != 1:
        raise InputError(f"linearize: f must return one row of numbers (m,), got shape {rows.shape}")
    outputs = [number(y) for y in rows.tolist()]
    entries = [*outputs, *chain.from_iterable(differentiate(outputs, inputs))]
    point = {symbol.serial: number(value) for symbol, value in zip(inputs, at.tolist(), strict=True)}
    values = substitute(entries, point)
    dtype = object if any(isinstance(v, Expression) for v in values) else float
    value_and_jacobian = np.array(values, dtype=dtype)
    value, J = value_and_jacobian[: rows.size], value_and_jacobian[rows.size :]
    return value, J.reshape(rows.size, at.size)


def jacobian(f: Callable[[np.ndarray], Any]) -> Callable[[Any], np.ndarray]:
    """The function x -> df/dx (m, n); see `linearize`."""
    return lambda x: linearize(f, x)[1]


def differentiate(outputs: Sequence[Scalar], inputs: Sequence[Expression]) -> list[list[Scalar]]:
    """Derivative of every output with respect to every input; the literal 0.0 where it does not depend on it."""
    nodes = schedule(outputs, first=min(x.serial for x in inputs)) if inputs else ()
    columns = [_tangents(nodes, x) for x in inputs]
    serials = [y.serial if isinstance(y, Expression) else -1 for y in outputs]
    return [[column.get(serial, 0.0) for column in columns] for serial in serials]


def _tangents(nodes: Sequence[Expression], x: Expression) -> dict[int, Scalar]:
    """Derivative with respect to x of every node that depends on x, by serial."""
    tangents: dict[int, Scalar] = {x.serial: 1.0}
    for node in nodes:
        below = tuple([tangents.get(a.serial, 0.0) if isinstance(a, Expression) else 0.0 for a in node.args])
        if any(isinstance(d, Expression) or d != 0.0 for d in below):
            tangents[node.serial] = node.operation.derivative(node, node.args, below)
    return tangents


def substitute(entries: Sequence[Scalar], values: Mapping[int, Scalar]) -> list[Scalar]:
    """Entries with other scalars in place of inputs (by serial); constants where only numbers remain."""
    new: dict[int, Scalar] = dict(values)
    origins = recorder()
    for node in schedule(entries, first=min(values)) if values else ():
        args = tuple([new.get(a.serial, a) if isinstance(a, Expression) else a for a in node.args])
        if any(p is not q for p, q in zip(args, node.args, strict=True)):
            since = next_serial() if origins else 0
            made = new[node.serial] = apply(node.operation.name, *args)
            if origins:
                origins.carry(node, made, since)
    return [new.get(e.serial, e) if isinstance(e, Expression) else e for e in entries]
