"""Friction laws, from slip to force: their interface, slip ratios, and the laws, from simple to physical.

A friction law is f(s) = sign(s) g(|s|). Written with `sign` and `abs` its traced derivative at s = 0 is 0 instead of
g'(0): a filter that linearises at rest would see ice. Written with `direction_and_size` it is right everywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ohmward.checks import (
    require_between,
    require_each_not_negative,
    require_each_positive,
    require_finite,
    require_positive,
)
from ohmward.errors import InputError
from ohmward.trace import clip, exp, maximum, minimum, where


def direction_and_size(x: Any) -> tuple[Any, Any]:
    """1 or -1, and |x|, with x = direction * size; zero counts as forward, nan stays nan in the size."""
    forward = x >= 0
    return where(forward, 1.0, -1.0), where(forward, x, -x)


#: Smallest speed [m/s] that a slip ratio divides by: a law in the slip ratio has infinite slope at rest.
SPEED_FLOOR = 0.05


class Contact(NamedTuple):
    """Contact of a wheel with the ground; floats, arrays or traced."""

    #:   rim speed less travel speed, along the wheel; with sideways slip the length of the slip vector
    slip_speed_m_s: Any
    rim_speed_m_s: Any  #:    r omega
    travel_speed_m_s: Any  #: of the wheel's centre, along the wheel
    load_N: Any  #:           normal force, >= 0


class TractionLaw(Protocol):
    """A law of friction between wheel and ground.

    Implementations are frozen dataclasses that check themselves. The force has the sign of the slip speed or is zero
    (the ground takes energy and never gives any), is odd in the direction of motion, continuous, and can be traced.
    """

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel, forward at positive slip speed."""
        ...


def contact(rim_speed_m_s: Any, travel_speed_m_s: Any, load_N: Any) -> Contact:
    """The contact of a wheel that does not slip sideways."""
    return Contact(rim_speed_m_s - travel_speed_m_s, rim_speed_m_s, travel_speed_m_s, load_N)


def bounded_slip_ratio(c: Contact, floor_m_s: float) -> Any:
    """Slip speed over the larger of rim speed, travel speed and floor: [T] (4.1), made safe at rest."""
    return c.slip_speed_m_s / maximum(maximum(abs(c.rim_speed_m_s), abs(c.travel_speed_m_s)), floor_m_s)


def creepage(c: Contact, floor_m_s: float) -> Any:
    """Slip speed over rim speed: shear of a point that rolls through the patch per metre of the patch.

    Driving it is the slip ratio i = 1 - v/(r omega); braking with the skid i_s = 1 - r omega/v it is -i_s/(1 - i_s).
    One variable serves both, and grows without limit as the wheel locks.
    """
    return c.slip_speed_m_s / maximum(abs(c.rim_speed_m_s), floor_m_s)


@dataclass(frozen=True)
class CoulombCreep:
    """Coulomb friction with viscous creep: the family of rigid-body simulators (MuJoCo's `solreffriction`).

    F = N clip(c s, -mu, mu)

    In adhesion the slip speed is proportional to the force; the ground gives mu N at most, and has no peak.
    """

    adhesion: float  #: mu, > 0
    slope_s_per_m: float  #: c, adhesion per slip speed while the wheel grips, > 0

    def __post_init__(self) -> None:
        require_each_positive("coulomb_creep.", self, "adhesion", "slope_s_per_m")

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel."""
        return contact.load_N * clip(self.slope_s_per_m * contact.slip_speed_m_s, -self.adhesion, self.adhesion)


#: C2 times the slip speed at the peak: 4.0 and 4.1 on Burckhardt's dry roads, 4.4 on wet asphalt.
SHARPNESS = 4.0


@dataclass(frozen=True)
class WardIagnemma:
    """Differentiable traction in the slip speed ([T] 4.3): no division, so no singularity at rest.

    F = N sign(s) [C1 (1 - e^(-C2 |s|)) + C3 |s|]

    C3 < 0 gives a peak at |s| = ln(C1 C2 / -C3) / C2; beyond it the falling line would end in a force that pulls the
    wrong way, so the adhesion stays at the sliding value.
    """

    c1: float  #: adhesion to which the exponential rises, > 0
    c2_s_per_m: float  #: rate of it, > 0
    c3_s_per_m: float = 0.0  #: slope at high slip; < 0 for ground with a peak, and then > -c1 * c2
    #: adhesion that remains beyond the peak, from 0 to the peak; without meaning where there is no peak
    sliding: float = 0.0

    def __post_init__(self) -> None:
        require_each_positive("ward_iagnemma.", self, "c1", "c2_s_per_m")
        require_finite("ward_iagnemma.c3_s_per_m", self.c3_s_per_m)
        if self.c3_s_per_m <= -self.c1 * self.c2_s_per_m:
            raise InputError(
                f"ward_iagnemma.c3_s_per_m must be > -c1 * c2 = {-self.c1 * self.c2_s_per_m:g}, or the traction falls "
                f"from the start; got {self.c3_s_per_m:g}"
            )
        require_between("ward_iagnemma.sliding", self.sliding, 0.0, self.peak_adhesion)

    @classmethod
    def with_peak(cls, peak: float, sliding: float, slip_speed_m_s: float) -> WardIagnemma:
        """The law with this peak adhesion at this slip speed and this sliding adhesion."""
        require_positive("slip_speed_m_s", slip_speed_m_s)
        fading = math.exp(-SHARPNESS)
        c1 = peak / (1 - fading - SHARPNESS * fading)
        c2_s_per_m = SHARPNESS / slip_speed_m_s
        return cls(c1, c2_s_per_m, -c1 * c2_s_per_m * fading, sliding)

    @property
    def peak_slip_speed_m_s(self) -> float:
        """Slip speed of the largest adhesion; inf if it never falls."""
        if self.c3_s_per_m >= 0:
            return math.inf
        return math.log(self.c1 * self.c2_s_per_m / -self.c3_s_per_m) / self.c2_s_per_m

    @property
    def peak_adhesion(self) -> float:
        """The largest adhesion; inf if it never stops growing."""
        if self.c3_s_per_m >= 0:
            return math.inf if self.c3_s_per_m > 0 else self.c1
        return self.c1 + self.c3_s_per_m * (self.peak_slip_speed_m_s + 1 / self.c2_s_per_m)

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel."""
        mu = adhesion(contact.slip_speed_m_s, self.c1, self.c2_s_per_m, self.c3_s_per_m)
        if self.c3_s_per_m < 0:
            direction, size = direction_and_size(contact.slip_speed_m_s)
            mu = where(size > self.peak_slip_speed_m_s, direction * maximum(direction * mu, self.sliding), mu)
        return contact.load_N * mu


def adhesion(slip_speed_m_s: Any, c1: Any, c2_s_per_m: Any, c3_s_per_m: Any = 0.0) -> Any:
    """Force over load, [T] 4.3, of the sign of the slip; the parameters may be states of a filter.

    The sign is put in the constants, which makes the traced force and slope shortest.
    """
    forward = slip_speed_m_s >= 0
    fade = where(forward, -c2_s_per_m, c2_s_per_m)
    return where(forward, -c1, c1) * np.expm1(fade * slip_speed_m_s) + c3_s_per_m * slip_speed_m_s


@dataclass(frozen=True)
class Burckhardt:
    """Adhesion as a function of the slip ratio alone, as measured on roads.

    mu = c1 (1 - e^(-c2 lambda)) - c3 lambda,  lambda = |s| / max(|r omega|, |v|)

    Beyond 1 (rim and travel opposed) it keeps its value at 1.
    """

    c1: float  #: adhesion to which the exponential rises, > 0
    c2: float  #: rate of it, > 0
    c3: float  #: adhesion that a sliding wheel has lost, >= 0, with the adhesion at slip ratio 1 not below 0
    speed_floor_m_s: float = SPEED_FLOOR  #: smallest speed that the slip ratio divides by, > 0

    def __post_init__(self) -> None:
        require_each_positive("burckhardt.", self, "c1", "c2", "speed_floor_m_s")
        require_between("burckhardt.c3", self.c3, 0.0, math.inf)
        if self.sliding < 0:
            raise InputError(
                f"burckhardt.c3 must be at most c1 (1 - exp(-c2)) = {self.sliding + self.c3:g}, or a sliding wheel is "
                f"pushed; got {self.c3:g}"
            )

    @property
    def peak_slip_ratio(self) -> float:
        """Slip ratio of the largest adhesion, in [0, 1]."""
        return 1.0 if self.c3 == 0 else min(1.0, math.log(self.c1 * self.c2 / self.c3) / self.c2)

    @property
    def peak_adhesion(self) -> float:
        """The largest adhesion."""
        return self._adhesion(self.peak_slip_ratio)

    @property
    def sliding(self) -> float:
        """Adhesion at slip ratio 1: a locked wheel, or one that spins on the spot."""
        return self._adhesion(1.0)

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel."""
        direction, size = direction_and_size(bounded_slip_ratio(contact, self.speed_floor_m_s))
        return contact.load_N * direction * self._adhesion(minimum(size, 1.0))

    def at_speed(self, speed_m_s: float) -> WardIagnemma:
        """The same law at one speed max(|r omega|, |v|), in the slip speed: C1 = c1, C2 = c2/V, C3 = -c3/V."""
        require_positive("speed_m_s", speed_m_s)
        return WardIagnemma(self.c1, self.c2 / speed_m_s, -self.c3 / speed_m_s, self.sliding)

    def _adhesion(self, slip_ratio: Any) -> Any:
        return -self.c1 * np.expm1(-self.c2 * slip_ratio) - self.c3 * slip_ratio


_LEAST_SLIP = 1e-12


@dataclass(frozen=True)
class Brush:
    """Brush theory (Wong): the tread is a row of bristles that shear through the patch until they slide.

    With load W, patch length l, stiffness k of the tread, deformation lambda_a ahead of the patch (a length, not the
    slip), K' = k l lambda_a and the creepage i = s / |r omega|:

        i <= i_c = mu W / (l k (l + lambda_a))   all bristles stick    F = k i (l lambda_a + l^2/2)
        i_c < i < mu W / K'                      the rear ones slide   F = mu W - lambda_a (mu W - K' i)^2 / (2 l K' i)
        mu W / K' <= i                           all slide             F = mu W

    lambda_a / K' = 1 / (k l), so the second line holds at lambda_a = 0 too, where nothing but an infinite creepage
    makes all bristles slide. Braking with the skid i_s is the same with i = i_s / (1 - i_s); [T] (4.2) mixes the cases
    lambda_a = 0 and > 0 and lacks the third line. The pressure is uniform; there is one coefficient of friction and so
    no falling branch.
    """

    adhesion: float  #: mu, of a bristle on the ground, > 0
    patch_length_m: float  #: l, > 0
    tread_stiffness_N_per_m2: float  #: k, force on a metre of patch for a metre of deformation, > 0
    lead_length_m: float = 0.0  #: lambda_a, >= 0
    speed_floor_m_s: float = SPEED_FLOOR  #: smallest rim speed that the creepage divides by, > 0

    def __post_init__(self) -> None:
        require_each_positive(
            "brush.", self, "adhesion", "patch_length_m", "tread_stiffness_N_per_m2", "speed_floor_m_s"
        )
        require_between("brush.lead_length_m", self.lead_length_m, 0.0, math.inf)

    @property
    def slip_stiffness_N(self) -> float:
        """Slope of the force at no slip, C_i = k l^2/2 without lead [N per unit of creepage]."""
        l, lead = self.patch_length_m, self.lead_length_m  # noqa: E741
        return self.tread_stiffness_N_per_m2 * (l * lead + l * l / 2)

    def critical_creepage(self, load_N: Any) -> Any:
        """i_c, at which the last bristle begins to slide."""
        l, lead = self.patch_length_m, self.lead_length_m  # noqa: E741
        return self.adhesion * load_N / (l * self.tread_stiffness_N_per_m2 * (l + lead))

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel."""
        direction, i = direction_and_size(creepage(contact, self.speed_floor_m_s))
        l, k = self.patch_length_m, self.tread_stiffness_N_per_m2  # noqa: E741
        full = self.adhesion * contact.load_N
        i_c = self.critical_creepage(contact.load_N)
        short = maximum(full - k * l * self.lead_length_m * i, 0.0)
        sliding = full - short * short / (2 * k * l * l * maximum(maximum(i, i_c), _LEAST_SLIP))
        return direction * where(i <= i_c, self.slip_stiffness_N * i, sliding)


_LEAST_LOAD_N = 1e-6
_SERIES_BELOW = 1e-3


@dataclass(frozen=True)
class Soil:
    """Properties of a soil."""

    name: str  #: in words
    frictional_modulus: float  #: k_phi [N/m^(n + 2)], > 0
    cohesive_modulus: float  #: k_c [N/m^(n + 1)], >= 0
    exponent: float  #: n, in (0, 3)
    cohesion_Pa: float  #: c, >= 0
    friction_deg: float  #: phi, in (0, 60]
    shear_length_m: float  #: K, > 0

    def __post_init__(self) -> None:
        require_each_positive("soil.", self, "frictional_modulus", "exponent", "friction_deg", "shear_length_m")
        require_each_not_negative("soil.", self, "cohesive_modulus", "cohesion_Pa")
        require_between("soil.friction_deg", self.friction_deg, 0.0, 60.0)
        if self.exponent >= 3:
            raise InputError(f"soil.exponent must be < 3 for Bekker's wheel, got {self.exponent:g}")


class Footprint(NamedTuple):
    """Sinkage [m] and length [m] of the contact of a wheel under a load."""

    sinkage_m: Any
    length_m: Any


@dataclass(frozen=True)
class SoftGround:
    """Soil under one size of rigid wheel: Bekker's sinkage, the shear of Janosi and Hanamoto (Wong, ch. 2).

        pressure under a plate       p = (k_c/b + k_phi) z^n
        sinkage of a wheel           z_0 = [3 W / ((3 - n) (k_c + b k_phi) sqrt(D))]^(2/(2n + 1))
        compaction resistance        R_c = (k_c + b k_phi) z_0^(n + 1) / (n + 1)
        contact length               l = sqrt(z_0 (D - z_0))
        traction                     F = (b l c + W tan phi) [1 - K/(i l) (1 - e^(-i l/K))],  i = s / |r omega|

    The pressure is assumed uniform along the contact. A spinning wheel digs in deeper (slip sinkage); that is not
    modelled.
    """

    soil: Soil  #: the soil
    #: of the wheel, > 0
    radius_m: float
    width_m: float
    speed_floor_m_s: float = SPEED_FLOOR  #: smallest rim speed that the creepage divides by, > 0

    def __post_init__(self) -> None:
        require_each_positive("soft_ground.", self, "radius_m", "width_m", "speed_floor_m_s")

    def footprint(self, load_N: Any) -> Footprint:
        """Sinkage, at most the radius, and length of the contact."""
        n, diameter_m = self.soil.exponent, 2 * self.radius_m
        weight = 3 * maximum(load_N, _LEAST_LOAD_N) / ((3 - n) * self._modulus * math.sqrt(diameter_m))
        sinkage_m = minimum(weight ** (2 / (2 * n + 1)), self.radius_m)
        return Footprint(sinkage_m, (sinkage_m * (diameter_m - sinkage_m)) ** 0.5)

    def compaction_N(self, load_N: Any) -> Any:
        """Force [N] that it takes to press the rut."""
        n = self.soil.exponent
        return self._modulus * self.footprint(load_N).sinkage_m ** (n + 1) / (n + 1)

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel, without the compaction resistance."""
        direction, i = direction_and_size(creepage(contact, self.speed_floor_m_s))
        length_m = self.footprint(contact.load_N).length_m
        cohesive_N = self.width_m * length_m * self.soil.cohesion_Pa
        strongest_N = cohesive_N + contact.load_N * math.tan(math.radians(self.soil.friction_deg))
        return direction * strongest_N * mean_shear(i * length_m / self.soil.shear_length_m)

    @property
    def _modulus(self) -> float:
        return self.soil.cohesive_modulus + self.width_m * self.soil.frictional_modulus


def mean_shear(x: Any) -> Any:
    """1 - (1 - e^(-x))/x for x >= 0: mean of 1 - e^(-j/K) while the shear j grows evenly from 0 to x K."""
    series = x * (1 / 2 - x * (1 / 6 - x / 24))
    safe = maximum(x, _SERIES_BELOW)
    return where(x < _SERIES_BELOW, series, 1 - (1 - exp(-safe)) / safe)
