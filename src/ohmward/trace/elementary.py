"""exp, log and other elementary functions as polynomials: the same bits on every machine, and SIMD everywhere.

Machine code and C99 use them instead of a libm, whose results differ between platforms and which has no vectors.
`expand` rewrites a program; the arithmetic is that of its precision. Errors in units in the last place (ulp), where
result and argument are normal numbers, measured by `tests/trace/test_elementary.py`:

    exp, log 1;  expm1, log1p, cosh 2;  sin, cos 3 and tan 4 up to |x| = 1e5 (single: 1e3);
    arctan, arctan2, sinh, tanh, arcsinh 3;  power 1 + |log2 of the result|.

Outside these ranges: exp overflows to inf and underflows gradually to 0 as it should, sinh and cosh overflow where exp
does, and nan gives nan. sin, cos and tan lose digits as |x| grows; arctan2 ignores the sign of a zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ohmward.trace.expression import Expression, Scalar, apply, next_serial
from ohmward.trace.expression import select as where
from ohmward.trace.functions import floor, maximum, minimum, sign
from ohmward.trace.program import Program, schedule


@dataclass(frozen=True)
class Precision:
    """Constants of the elementary functions in double or single precision."""

    name: str  #:     "f64" or "f32"
    rounder: float  #:  adding and subtracting it rounds to a whole number
    #: exp of more is inf, of less is 0
    overflow: float
    underflow: float
    #: the smallest normal number, and a power of two, with its exponent, that makes subnormals normal
    tiny: float
    lift: tuple[float, float]
    #: split into parts of few bits, so that products with small whole numbers are exact
    ln2: tuple[float, float]
    half_pi: tuple[float, float, float]
    #: coefficients of the polynomials, the lowest first
    exp: tuple[float, ...]
    log: tuple[float, ...]
    sin: tuple[float, ...]
    cos: tuple[float, ...]
    arctan: tuple[tuple[float, ...], tuple[float, ...]]


#: Coefficients: Taylor (exp), fdlibm (log, sin, cos), Cephes (arctan).
F64 = Precision(
    name="f64",
    rounder=1.5 * 2.0**52,
    overflow=709.782712893384,
    underflow=-745.2,
    tiny=2.0**-1022,
    lift=(2.0**54, 54.0),
    ln2=(6.93147180369123816490e-01, 1.90821492927058770002e-10),
    half_pi=(1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21),
    exp=tuple(1.0 / math.factorial(k) for k in range(2, 14)),
    log=(
        6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01, 2.222219843214978396e-01,
        1.818357216161805012e-01, 1.531383769920937332e-01, 1.479819860511658591e-01,
    ),
    sin=(
        -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
        2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
    ),
    cos=(
        4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
        -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
    ),
    arctan=(
        (
            -6.485021904942025371773e1, -1.228866684490136173410e2, -7.500855792314704667340e1,
            -1.615753718733365076637e1, -8.750608600031904122785e-1,
        ),
        (
            1.945506571482613964425e2, 4.853903996359136964868e2, 4.328810604912902668951e2,
            1.650270098316988542046e2, 2.485846490142306297962e1, 1.0,
        ),
    ),
)  # fmt: skip
F32 = Precision(
    name="f32",
    rounder=1.5 * 2.0**23,
    overflow=88.72283,
    underflow=-103.98,
    tiny=2.0**-126,
    lift=(2.0**25, 25.0),
    ln2=(0.693359375, -2.12194440e-4),
    half_pi=(1.5703125, 4.837512969970703125e-4, 7.54978995489188216e-8),
    exp=tuple(1.0 / math.factorial(k) for k in range(2, 8)),
    log=(0.66666662693, 0.40000972152, 0.28498786688, 0.24279078841),
    sin=(-1.6666654611e-1, 8.3321608736e-3, -1.9515295891e-4),
    cos=(4.166664568298827e-2, -1.388731625493765e-3, 2.443315711809948e-5),
    arctan=((-3.33329491539e-1, 1.99777106478e-1, -1.38776856032e-1, 8.05374449538e-2), (1.0,)),
)  # fmt: skip
PRECISIONS = {p.name: p for p in (F64, F32)}


def expand(program: Program, precision: Precision) -> Program:
    """The program with elementary functions replaced by their polynomials, made once for each precision."""
    if precision.name not in program.expansions:
        program.expansions[precision.name] = _expansion(program, precision)
    return program.expansions[precision.name]


def _expansion(program: Program, precision: Precision) -> Program:
    new: dict[int, Scalar] = {symbol.serial: symbol for symbol in program.inputs}

    def expanded(x: Any) -> Any:
        return new[x.serial] if isinstance(x, Expression) else x

    for node in program.nodes:
        arguments = [expanded(a) for a in node.args]
        formula, since = FORMULAS.get(node.operation.name), next_serial()
        new[node.serial] = formula(precision, *arguments) if formula else apply(node.operation.name, *arguments)
        if program.origins:
            program.origins.carry(node, new[node.serial], since)
    outputs = tuple(expanded(y) for y in program.outputs)
    return replace(program, nodes=schedule(outputs), outputs=outputs)


def _polynomial(x: Scalar, coefficients: Sequence[float]) -> Scalar:
    """c0 + c1 x + c2 x^2 + ... by Horner's rule."""
    result: Scalar = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        result = c + x * result
    return result


def _nearest(p: Precision, x: Scalar) -> Scalar:
    """The nearest whole number, ties to even; |x| below half the rounder."""
    return (x + p.rounder) - p.rounder


def _reduced(p: Precision, x: Scalar) -> tuple[Scalar, Scalar]:
    """Parts n and e^r - 1 of x = n ln 2 + r, |r| <= ln(2)/2; x within the range of exp."""
    n = _nearest(p, x * (1.0 / math.log(2.0)))
    r = (x - n * p.ln2[0]) - n * p.ln2[1]
    return n, r + (r * r) * _polynomial(r, p.exp)


def _exp(p: Precision, x: Scalar) -> Scalar:
    n, e = _reduced(p, minimum(maximum(x, p.underflow), p.overflow))
    half = _nearest(p, 0.5 * n)
    # in two factors: 2^n alone is not a normal number at either end of the range
    y = ((e + 1.0) * apply("power_of_two", half)) * apply("power_of_two", n - half)
    return where(x > p.overflow, math.inf, where(x != x, x, y))


def _expm1(p: Precision, x: Scalar) -> Scalar:
    # above 60 the 1 is below the last bit, and below -60 the result is -1
    n, e = _reduced(p, minimum(maximum(x, -60.0), 60.0))
    scale = apply("power_of_two", n)
    y = e * scale + (scale - 1.0)
    return where(x > 60.0, _exp(p, x), where(x != x, x, where(x == 0.0, x, y)))


def _log(p: Precision, x: Scalar) -> Scalar:
    small = x < p.tiny
    lifted = where(small, x * p.lift[0], x)
    e = apply("exponent", lifted)
    m = lifted * apply("power_of_two", -e)
    high = m > math.sqrt(2.0)
    f = where(high, 0.5 * m, m) - 1.0
    k = where(high, e + 1.0, e) - where(small, p.lift[1], 0.0)
    s = f / (2.0 + f)
    z, half = s * s, 0.5 * f * f
    y = k * p.ln2[0] - ((half - (s * (half + z * _polynomial(z, p.log)) + k * p.ln2[1])) - f)
    ordinary = where(x == math.inf, x, where(x == 0.0, -math.inf, y))
    return where(x >= 0.0, ordinary, math.nan)


def _log1p(p: Precision, x: Scalar) -> Scalar:
    u = 1.0 + x
    rounded = where(abs(x) < 1e6, (x - (u - 1.0)) / u, 0.0)  # log of the part that rounding took from u
    return where(u == 1.0, x, where(u == 0.0, -math.inf, _log(p, u) + rounded))


def _quadrant(p: Precision, x: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Sine and cosine of r, and q, for x = (4 k + q) pi/2 + r with |r| <= pi/4 and q from -2 to 2."""
    n = _nearest(p, x * (2.0 / math.pi))
    r = ((x - n * p.half_pi[0]) - n * p.half_pi[1]) - n * p.half_pi[2]
    z = r * r
    sine = r + r * (z * _polynomial(z, p.sin))
    cosine = 1.0 - (0.5 * z - z * (z * _polynomial(z, p.cos)))
    return sine, cosine, n - 4.0 * _nearest(p, 0.25 * n)


def _sin(p: Precision, x: Scalar) -> Scalar:
    sine, cosine, q = _quadrant(p, x)
    y = where(abs(q) == 1.0, cosine, sine)
    return where((q == -1.0) | (abs(q) == 2.0), -y, y)


def _cos(p: Precision, x: Scalar) -> Scalar:
    sine, cosine, q = _quadrant(p, x)
    y = where(abs(q) == 1.0, sine, cosine)
    return where((q == 1.0) | (abs(q) == 2.0), -y, y)


def _tan(p: Precision, x: Scalar) -> Scalar:
    return _sin(p, x) / _cos(p, x)


def _arctan(p: Precision, x: Scalar) -> Scalar:
    a = abs(x)
    large = a > 1.0
    t = where(large, 1.0 / a, a)  # arctan a = pi/2 - arctan(1/a)
    steep = t > math.tan(math.pi / 8)
    u = where(steep, (t - 1.0) / (t + 1.0), t)  # arctan t = pi/4 + arctan((t - 1)/(t + 1))
    z = u * u
    above, below = p.arctan
    core = u + u * (z * _polynomial(z, above) / _polynomial(z, below))
    y = where(steep, math.pi / 4 + core, core)
    y = where(large, math.pi / 2 - y, y)
    return where(x < 0.0, -y, y)


def _arctan2(p: Precision, y: Scalar, x: Scalar) -> Scalar:
    both = abs(x) == abs(y)  # also both inf and both 0, whose quotient is nan
    angle = _arctan(p, where(both, sign(x) * sign(y), y / x))
    turned = where(x < 0.0, where(y < 0.0, angle - math.pi, angle + math.pi), angle)
    return where((x == 0.0) & (y == 0.0), 0.0, where((x != x) | (y != y), math.nan, turned))


def _tanh(p: Precision, x: Scalar) -> Scalar:
    t = _expm1(p, minimum(2.0 * abs(x), 50.0))
    y = t / (t + 2.0)
    return where(x < 0.0, -y, y)


def _sinh(p: Precision, x: Scalar) -> Scalar:
    t = _expm1(p, abs(x))
    y = where(t < math.inf, 0.5 * (t + t / (t + 1.0)), t)
    return where(x < 0.0, -y, y)


def _cosh(p: Precision, x: Scalar) -> Scalar:
    e = _exp(p, abs(x))
    return 0.5 * e + 0.5 / e


def _arcsinh(p: Precision, x: Scalar) -> Scalar:
    a = abs(x)
    square = where(a < 1e8, a * a, 0.0)
    y = where(a < 1e8, _log1p(p, a + square / (1.0 + apply("sqrt", 1.0 + square))), _log(p, a) + math.log(2.0))
    return where(x < 0.0, -y, y)


def _power(p: Precision, base: Scalar, exponent: Scalar) -> Scalar:
    size = _exp(p, exponent * _log(p, abs(base)))
    whole = floor(exponent) == exponent
    odd = 2.0 * floor(0.5 * exponent) != exponent
    signed = where(base < 0.0, where(whole, where(odd, -size, size), math.nan), size)
    return where((exponent == 0.0) | (base == 1.0), 1.0, signed)


#: One formula for each operation that needs one: (precision, *arguments) -> scalar.
FORMULAS: dict[str, Callable[..., Scalar]] = {
    "exp": _exp,
    "expm1": _expm1,
    "log": _log,
    "log1p": _log1p,
    "sin": _sin,
    "cos": _cos,
    "tan": _tan,
    "arctan": _arctan,
    "arctan2": _arctan2,
    "sinh": _sinh,
    "cosh": _cosh,
    "tanh": _tanh,
    "arcsinh": _arcsinh,
    "power": _power,
}
