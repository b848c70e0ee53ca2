"""The slip of wheels on a floor by quadrature over its friction and stiffness: the rule that `SlipCurves` stand for."""

import numpy as np

from ohmward.traction.terrain.floor import AS_LEARNT, Floor, SlipBelief, SlipScale, scaled, slips_of_floors


def slip_belief(
    floor: Floor, force_share: np.ndarray, force_std: np.ndarray, scale: SlipScale = AS_LEARNT
) -> SlipBelief:
    """Belief in the slip of wheels on this floor.

    force_share, force_std: (..., n) traction over load, and its standard deviation.
    scale: for the motion of the wheels.
    """
    at_node, weights = slips_of_floors(floor, force_share)
    mean = (weights * at_node).sum(axis=0)
    off = np.sqrt(weights) * (at_node - mean)
    cov = np.einsum("q...i,q...j->...ij", off, off)
    shifted = (slips_of_floors(floor, force_share + e) for e in (force_std, -force_std))
    ahead, behind = ((probable * slip).sum(axis=0) for slip, probable in shifted)
    own = ((ahead - behind) / 2) ** 2
    return scaled(SlipBelief(mean, cov + own[..., None] * np.eye(mean.shape[-1])), scale, floor)
