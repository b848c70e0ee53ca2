"""A battery from a file of the Battery Parameter eXchange format (BPX): a cell of porous electrodes, in JSON.

With the SoC z the stoichiometries of the electrodes go between their limits in opposite directions, so that

OCV(z) = U_p(x_p(z)) - U_n(x_n(z)),

and likewise for its change with temperature. For small currents the resistances are those of the single particle model
with electrolyte, linearised about rest (Marquis et al., J. Electrochem. Soc. 166 A3693, 2019): with the area A of all
electrode pairs, thickness L, surface a per volume, and transport efficiency B of each layer,

R_0 = sum over electrodes of  R T / (F j_0 a L A) + L / (3 sigma A) + L / (3 kappa B A),   + L_s / (kappa B_s A),

where j_0 = F K sqrt(x (1 - x)). Diffusion in the particles (radius r, diffusivity D) is an RC pair for each electrode:
under a steady current the surface lies I T / Q_k from the mean, T = r^2 / 15 D, Q_k the electrode's whole charge, and

R_k(z) = |dU_k / dx| T / Q_k,   tau_k = 3 T / 7,

which has the same final value and the same area above the step response as the sphere.
"""

from __future__ import annotations

import ast
import json
import math
from collections.abc import Callable
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import (
    assumed_capacity,
    chemistry_contradiction,
    chemistry_name,
    generic_battery,
    start_noise,
)
from ohmward.battery.models.noise import AGED_RESISTANCE_STD
from ohmward.battery.models.ocv import OCV_GRID, OcvCurve, monotone
from ohmward.battery.models.temperature import FARADAY_C_PER_MOL, GAS_J_PER_MOL_K, KELVIN, ROOM_DEGC
from ohmward.battery.models.thevenin import RESISTANCE_GRID, Thevenin
from ohmward.checks import require_positive
from ohmward.errors import InputError
from ohmward.quantities import SECONDS_PER_HOUR

#: Distance from SoC 0 and 1 within which resistances are held: 1 / j_0 may diverge.
_END_DISTANCE = 0.01
#: Half step of a stoichiometry for the slope of a potential.
_DX = 1e-3
#: Relative difference of electrode and nominal capacity beyond which a file contradicts itself.
_CAPACITY_OFF = 0.3
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    name: getattr(np, name)
    for name in ("exp", "log", "sqrt", "sinh", "cosh", "tanh", "sin", "cos", "tan", "arctan", "abs")
}
_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.USub: np.negative,
    ast.UAdd: np.positive,
}

Function = Callable[[np.ndarray], np.ndarray]


class _Electrode(NamedTuple):
    """One electrode, along the SoC of the cell."""

    stoichiometry: Function
    potential_V: Function  #: as a function of the stoichiometry
    entropy_V_per_K: Function  #: likewise
    charge_As: float  #: from stoichiometry 0 to 1
    usable_As: float  #: between its limits
    lag_s: float
    exchange_A: Function  #: exchange current as a function of the stoichiometry
    ohm: float  #: of matrix and electrolyte
    rate_K: float  #: activation of the exchange current
    lag_K: float  #: activation of the diffusivity


def battery_from_bpx(
    path: str | PathLike[str], chemistry: str, n_series: int = 1, capacity_Ah: float | None = None, label: str = ""
) -> Battery:
    """Battery made of the cells that a BPX file describes.

    The curve, its change with temperature, the resistances and the time constants come from the file; everything else,
    and the spread from cell to cell, from the chemistry.

    >>> battery_from_bpx("cell.json", "nmc", n_series=4).n_series  # doctest: +SKIP
    4

    chemistry: such as "nmc".
    capacity_Ah: of all parallel strings together [Ah]; None for a single string.
    label: name of the battery; by default the file's title.

    Raises:
        InputError: the file cannot be read, is not a BPX file, is of another chemistry, or has blended electrodes,
            which are not supported.
    """
    source = _Source(Path(path))
    cell = source.table("Parameterisation", "Cell")
    area_m2 = source.number(cell, "Electrode area [m2]") * source.number(
        cell, "Number of electrode pairs connected in parallel to make a cell"
    )
    reference_K = float(cell.get("Reference temperature [K]") or ROOM_DEGC + KELVIN)
    negative = source.electrode("Negative electrode", area_m2, reference_K, rises=True)
    positive = source.electrode("Positive electrode", area_m2, reference_K, rises=False)
    cell_Ah = min(negative.usable_As, positive.usable_As) / SECONDS_PER_HOUR
    nominal_Ah = source.number(cell, "Nominal cell capacity [A.h]")
    if abs(cell_Ah / nominal_Ah - 1.0) > _CAPACITY_OFF:
        raise InputError(
            f"BPX file {path}: the electrodes hold {cell_Ah:.3g} Ah, and the nominal capacity is {nominal_Ah:.3g} Ah; "
            "correct electrode area, number of pairs or stoichiometries"
        )
    one = _thevenin(source, cell_Ah, area_m2, reference_K, negative, positive)
    if contradiction := chemistry_contradiction(chemistry_name(chemistry), one.ocv.voltage_V):
        raise InputError(f"BPX file {source.path}: its open-circuit voltage {contradiction}")
    generic = generic_battery(chemistry, capacity_Ah or cell_Ah, n_series, label or source.title)
    strings = generic.capacity_Ah / cell_Ah
    pack = replace(one.in_parallel(strings), capacity_Ah=generic.capacity_Ah, ocv_slip=generic.thevenin.ocv_slip)
    model = pack.in_series(n_series)
    curve_V = model.ocv.voltage_V
    return replace(
        generic,
        voltage_min_V=min(n_series * source.number(cell, "Lower voltage cut-off [V]"), curve_V[0]),
        voltage_max_V=max(n_series * source.number(cell, "Upper voltage cut-off [V]"), 1.02 * curve_V[-1]),
        thevenin=model,
        noise=replace(start_noise(generic.chemistry, n_series, ocv_known=True), resistance_std=AGED_RESISTANCE_STD),
        not_identified=(
            f"everything: curve and resistances are those of {source.path.name}, a cell of this type",
            assumed_capacity("as given" if capacity_Ah else f"that of the electrodes ({nominal_Ah:g} Ah nominal)"),
        ),
    )


def _thevenin(
    source: _Source, cell_Ah: float, area_m2: float, reference_K: float, negative: _Electrode, positive: _Electrode
) -> Thevenin:
    """The circuit of one cell."""
    fine = OCV_GRID
    inside = np.clip(RESISTANCE_GRID, _END_DISTANCE, 1.0 - _END_DISTANCE)
    both = (negative, positive)
    ocv_V = positive.potential_V(positive.stoichiometry(fine)) - negative.potential_V(negative.stoichiometry(fine))
    entropy = [e.entropy_V_per_K(e.stoichiometry(fine)) for e in both]
    transfer_ohm = [
        GAS_J_PER_MOL_K * reference_K / (FARADAY_C_PER_MOL * e.exchange_A(e.stoichiometry(inside))) for e in both
    ]
    conducted_ohm = source.separator_ohm(area_m2) + sum(e.ohm for e in both)
    r0_ohm = tuple((conducted_ohm + transfer_ohm[0] + transfer_ohm[1]).tolist())
    diffusion_ohm = [_diffusion_ohm(e, inside) for e in both]
    pairs = sorted((3.0 * e.lag_s / 7.0, row) for e, row in zip(both, diffusion_ohm, strict=True))
    middle = RESISTANCE_GRID.size // 2
    shares = [conducted_ohm, *(ohm[middle] for ohm in transfer_ohm)]
    conduction_K = source.activation_K(source.table("Parameterisation", "Electrolyte", optional=True), "Conductivity")
    activations_K = [conduction_K, *(e.rate_K for e in both)]
    lag_K = float(np.average([e.lag_K for e in both], weights=[sum(row) for row in diffusion_ohm]))
    return Thevenin(
        cell_Ah,
        OcvCurve(tuple(monotone(ocv_V).tolist()), (), tuple((entropy[1] - entropy[0]).tolist()), reference_K - KELVIN),
        r0_ohm,
        r0_ohm,
        tuple(row for _, row in pairs),
        tuple(tau_s * (1.0 + 1e-6 * k) for k, (tau_s, _) in enumerate(pairs)),
        activation_K=float(np.average(activations_K, weights=shares)),
        reference_degC=reference_K - KELVIN,
        pair_activation_K=lag_K,
        tau_activation_K=lag_K,
    )


def _diffusion_ohm(e: _Electrode, soc: np.ndarray) -> tuple[float, ...]:
    """(M,) resistance of the diffusion in an electrode's particles, with the slope averaged over a twentieth of SoC."""
    near = np.linspace(-0.025, 0.025, 11)
    x = e.stoichiometry(np.clip(soc[:, None] + near, _END_DISTANCE, 1.0 - _END_DISTANCE))
    slopes = np.abs(e.potential_V(x + _DX) - e.potential_V(x - _DX)) / (2.0 * _DX)
    return tuple((slopes.mean(axis=1) * e.lag_s / e.charge_As).tolist())


class _Source:
    """A BPX file; every error names it, and what is missing."""

    def __init__(self, path: Path):
        self.path = path
        try:
            self.content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(f"BPX file {path} cannot be read: {error}") from error
        if not isinstance(self.content, dict) or "Parameterisation" not in self.content:
            raise InputError(f'{path} is no BPX file: it has no "Parameterisation"; see https://bpxstandard.com')

    @property
    def title(self) -> str:
        """Name of the cell in the file."""
        header = self.content.get("Header")
        return str(header.get("Title") or self.path.stem) if isinstance(header, dict) else self.path.stem

    def table(self, *keys: str, optional: bool = False) -> dict[str, Any]:
        """A part of the file."""
        found = self.content
        for key in keys:
            found = found.get(key) if isinstance(found, dict) else None
        if isinstance(found, dict):
            return found
        if optional:
            return {}
        raise InputError(f"BPX file {self.path} has no {' / '.join(keys)}")

    def number(self, table: dict[str, Any], key: str) -> float:
        """A number > 0 of the file."""
        value = table.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f'BPX file {self.path}: "{key}" must be a number, got {value!r}')
        require_positive(f'BPX file {self.path}: "{key}"', float(value))
        return float(value)

    def function(self, table: dict[str, Any], key: str) -> Function:
        """A function of the file: a number, a table of x and y, or an expression in x."""
        value = table.get(key)
        if isinstance(value, int | float) and not isinstance(value, bool):
            return lambda x: np.full(np.shape(x), float(value))
        if isinstance(value, dict) and {"x", "y"} <= set(value):
            at, of = np.asarray(value["x"], dtype=float), np.asarray(value["y"], dtype=float)
            return lambda x: np.interp(x, at, of)
        try:
            tree = ast.parse(str(value).strip(), mode="eval").body if isinstance(value, str) else None
            if tree is None:
                raise ValueError("neither a number, a table of x and y, nor an expression")
            _evaluated(tree, np.array([0.5]))
        except (SyntaxError, ValueError) as error:
            raise InputError(f'BPX file {self.path}: "{key}" cannot be read: {error}') from error
        return lambda x: np.asarray(_evaluated(tree, np.asarray(x, dtype=float)) + np.zeros(np.shape(x)))

    def activation_K(self, table: dict[str, Any], of: str) -> float:
        """An activation energy as a temperature; 0 where the file has none."""
        return max(float(table.get(f"{of} activation energy [J.mol-1]") or 0.0), 0.0) / GAS_J_PER_MOL_K

    def conductivity_S_m(self) -> float:
        """Conductivity of the electrolyte at rest; infinite where the file has none, as for a single particle model."""
        electrolyte = self.table("Parameterisation", "Electrolyte", optional=True)
        if not electrolyte:
            return math.inf
        conditions = self.table("State", "Initial conditions", optional=True)
        rest = electrolyte.get("Initial concentration [mol.m-3]") or conditions.get(
            "Initial electrolyte concentration [mol.m-3]"
        )
        return float(self.function(electrolyte, "Conductivity [S.m-1]")(np.array([float(rest or 1000.0)]))[0])

    def separator_ohm(self, area_m2: float) -> float:
        """Resistance of the separator of one cell."""
        layer = self.table("Parameterisation", "Separator", optional=True)
        if not layer or math.isinf(kappa := self.conductivity_S_m()):
            return 0.0
        efficiency = self.number(layer, "Transport efficiency")
        return self.number(layer, "Thickness [m]") / (kappa * efficiency * area_m2)

    def electrode(self, name: str, area_m2: float, reference_K: float, rises: bool) -> _Electrode:
        """An electrode; rises: True where its stoichiometry rises with the SoC."""
        t = self.table("Parameterisation", name)
        if "Particle" in t:
            raise InputError(
                f"BPX file {self.path}: {name} is a blend of materials, which is not read here; "
                "identify the cell from a test"
            )
        low, high = (self.number(t, f"{side} stoichiometry") for side in ("Minimum", "Maximum"))
        if not low < high <= 1.0:
            raise InputError(f"BPX file {self.path}: stoichiometries of the {name} must rise within 0 to 1")
        thickness_m, radius_m = self.number(t, "Thickness [m]"), self.number(t, "Particle radius [m]")
        surface_m2 = self.number(t, "Surface area per unit volume [m-1]") * thickness_m * area_m2
        volume_m3 = surface_m2 * radius_m / 3.0
        charge_As = FARADAY_C_PER_MOL * self.number(t, "Maximum concentration [mol.m-3]") * volume_m3
        middle = np.array([0.5 * (low + high)])
        diffusivity = float(self.function(t, "Diffusivity [m2.s-1]")(middle)[0])
        rate = self.number(t, "Reaction rate constant [mol.m-2.s-1]")
        ohm = 0.0
        if "Conductivity [S.m-1]" in t:
            ohm += thickness_m / (3.0 * self.number(t, "Conductivity [S.m-1]") * area_m2)
        if "Transport efficiency" in t:
            kappa = self.conductivity_S_m()
            ohm += thickness_m / (3.0 * kappa * self.number(t, "Transport efficiency") * area_m2)
        entropy = "Entropic change coefficient [V.K-1]"
        return _Electrode(
            (lambda z: low + z * (high - low)) if rises else (lambda z: high - z * (high - low)),
            self.function(t, "OCP [V]"),
            self.function(t, entropy) if t.get(entropy) is not None else np.zeros_like,
            charge_As,
            charge_As * (high - low),
            radius_m**2 / (15.0 * diffusivity),
            lambda x: FARADAY_C_PER_MOL * rate * np.sqrt(np.clip(x * (1.0 - x), 1e-4, None)) * surface_m2,
            ohm,
            self.activation_K(t, "Reaction rate constant"),
            self.activation_K(t, "Diffusivity"),
        )


def _evaluated(node: ast.expr, x: np.ndarray) -> Any:
    """Evaluate an expression in x of numbers, + - * / ** and functions; nothing else is called.

    Raises:
        ValueError: the expression contains anything else.
    """
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return float(value)
        case ast.Name(id="x"):
            return x
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_evaluated(operand, x))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_evaluated(left, x), _evaluated(right, x))
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in _FUNCTIONS:
            return _FUNCTIONS[name](_evaluated(argument, x))
    raise ValueError(f"{ast.unparse(node)!r} is no expression in x with {', '.join(_FUNCTIONS)}")
