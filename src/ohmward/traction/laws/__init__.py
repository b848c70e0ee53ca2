"""What the ground gives a wheel for its slip: one law per file, all behind `TractionLaw`."""

from ohmward.traction.laws.brush import Brush
from ohmward.traction.laws.burckhardt import Burckhardt
from ohmward.traction.laws.coulomb_creep import CoulombCreep
from ohmward.traction.laws.law import Contact, TractionLaw, contact
from ohmward.traction.laws.soft_ground import SoftGround, Soil
from ohmward.traction.laws.ward_iagnemma import WardIagnemma

__all__ = [
    "Brush",
    "Burckhardt",
    "Contact",
    "CoulombCreep",
    "SoftGround",
    "Soil",
    "TractionLaw",
    "WardIagnemma",
    "contact",
]
