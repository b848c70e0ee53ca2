"""The most that one core can do: fused multiply-adds in registers, nothing else. What speeds are measured against."""

from __future__ import annotations

import time

import numpy as np

from ohmward.trace.elementary import PRECISIONS
from ohmward.trace.lower.llvm_instructions import Target
from ohmward.trace.lower.llvm_machine_code import compile_scan, vector_bits
from ohmward.trace.lower.llvm_source import ARGUMENTS

_CHAINS = 16
_STEPS = 2_000_000


def peak_flops(precision: str = "f64", repeats: int = 5) -> float:
    """Floating-point operations per second of one core, a fused multiply-add counting as two."""
    target = Target(PRECISIONS[precision], vector_bits() // (64 if precision == "f64" else 32))
    run, engine = compile_scan(_source(target), "ohmward_peak")
    memory = np.zeros(64)
    best = np.inf
    for _ in range(repeats):
        began = time.perf_counter()
        run(memory.ctypes.data, 8, None, None, None, None, 0, _STEPS, 0, 1)
        best = min(best, time.perf_counter() - began)
    del engine
    return 2.0 * _CHAINS * target.width * _STEPS / best


def _source(target: Target) -> str:
    """Independent chains of x = x a + b, enough of them to hide the latency."""
    kind, function = target.number, f"llvm.fma.{target.suffix}"
    chains = range(_CHAINS)
    lines = [
        f"define void @ohmward_peak({ARGUMENTS}) {{",
        "entry:",
        "  br label %step",
        "step:",
        "  %t = phi i64 [%first, %entry], [%t1, %step]",
        *(f"  %x{k} = phi {kind} [{target.constant(float(k))}, %entry], [%y{k}, %step]" for k in chains),
        *(f"  %y{k} = call {kind} @{function}({_factors(target, k)})" for k in chains),
        "  %t1 = add i64 %t, 1",
        "  %go = icmp slt i64 %t1, %last",
        "  br i1 %go, label %step, label %end",
        "end:",
        *(f"  %s{k} = fadd {kind} %y{k}, {f'%s{k - 1}' if k else f'%y{_CHAINS - 1}'}" for k in chains),
        f"  store {kind} %s{_CHAINS - 1}, ptr %state, align 8",
        "  ret void",
        "}",
        f"declare {kind} @{function}({kind}, {kind}, {kind})",
    ]
    return "\n".join([*lines, ""])


def _factors(target: Target, k: int) -> str:
    kind = target.number
    return f"{kind} %x{k}, {kind} {target.constant(0.999)}, {kind} {target.constant(0.5)}"
