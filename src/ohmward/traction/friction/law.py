"""Interface of all friction laws: force from a contact; and the simplest law, that of rigid-body simulators.

A friction law is f(s) = sign(s) g(|s|). Written with `sign` and `abs` its traced derivative at s = 0 is 0 instead of
g'(0): a filter that linearises at rest would see ice. Written with the two parts from here it is right everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from ohmward.checks import require_each_positive
from ohmward.trace import clip, maximum, where


def direction_and_size(x: Any) -> tuple[Any, Any]:
    """1 or -1, and |x|, with x = direction * size; zero counts as forward, nan stays nan in the size."""
    forward = x >= 0
    return where(forward, 1.0, -1.0), where(forward, x, -x)


#: Least speed [m/s] that a slip ratio is taken against: a law in the slip ratio has infinite slope at rest.
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
    (the ground takes energy and never gives any), is odd in the direction of motion, continuous, and traces.
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
