"""Evidence of a voltage for one hypothesis about the battery against another."""

from __future__ import annotations

from ohmward.battery.soc.augmented_thevenin import VoltageError
from ohmward.filters.belief import Innovation
from ohmward.trace import clip, log, minimum
from ohmward.trace.expression import Scalar


def log_likelihood(
    innovation: Innovation, R: Scalar, error: VoltageError, renewed_V2: Scalar, largest_nis: float
) -> Scalar:
    """Log density of a voltage before it was used, up to a constant that is the same for every belief.

    With A = S - R the variance of the voltage by the state, f the part of it that the process noise brings back
    whenever it was learnt, v the variance of one sample and w its weight:

        -(nu^2 / S' + ln(S' / R') + ln(v + f) / w) / 2,    R' = R + w f,    S' = R' + A - f

    The density of one sample to the power of 1/w, averaged over the part of the state that stays: one observation in
    every w samples, as in the update. As a part of the state f would be charged for with every sample, and prefer
    whichever hypothesis has the least resistance. With w = 1 it is ln N(nu; 0, S).

    Args:
        innovation: nu (1,) and S (1, 1), [V] and [V^2].
        R: of the update [V^2], w v or more.
        error: v and w.
        renewed_V2: f [V^2]; at most A of it is taken.
        largest_nis: of one sample: an outlier counts no more.
    """
    nu, S, w = innovation.value[0], innovation.cov[0, 0], error.weight
    f = clip(renewed_V2, 0.0, S - R)
    S, R = S + (w - 1.0) * f, R + w * f
    return -0.5 * (minimum(nu * nu / S, largest_nis) + log(S / R) + log(error.variance + f) / w)
