"""Checks of a finished run of the speed observer: faults that it met, and a model that does not fit the log."""

from __future__ import annotations

import numpy as np

from ohmward.logs.log import Note
from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.estimator import SlipRun

#: A sensor contradicts the model where it is refused in more than this share of the samples; a robot that slips now and
#: then has a hundredth of that.
CONTRADICTS = 0.1

#: Flags of a sensor that the model contradicts, and the advice.
CONTRADICTIONS = {
    SlipFlag.ENCODER_DOUBTED: "encoders do not move as motors and ground allow: check their signs, their order, "
    "--motor-shaft and the mass and torque constant of the robot file",
    SlipFlag.GYRO_REJECTED: "the gyro turns otherwise than the wheels: check its sign and unit, left and right, and "
    "the track; wheels that scrub in turns need the chassis skid-steer in the robot file",
    SlipFlag.SPEED_REJECTED: "the speed from outside contradicts wheels and motors: check its unit, its delay "
    "(speed_age_s) and its standard deviation",
}


def fit_notes(run: SlipRun) -> tuple[Note, ...]:
    """Warnings of what the observer met on the way."""
    spikes = int(np.count_nonzero(run.flags & SlipFlag.ENCODER_SPIKE))
    text = (
        f"{spikes} of {len(run.flags)} samples in which an encoder jumps as no wheel can: "
        "not used; check its cable and counter"
    )
    return (*([Note(text, "warning")] if spikes else []), *misfits(run))


def misfits(run: SlipRun) -> tuple[Note, ...]:
    """Warnings that the model does not fit the log, whose estimates are not to be trusted then; none where it fits."""
    shares = {flag: float(np.mean(run.flags & flag != 0)) for flag in CONTRADICTIONS}
    found = [
        f"the model does not fit {_percent(share)} of the log: {CONTRADICTIONS[flag]}"
        for flag, share in shares.items()
        if share > CONTRADICTS
    ]
    restarts = int(np.count_nonzero(run.flags & SlipFlag.RESTARTED))
    if restarts:
        found.append(
            f"the observer started again {restarts} times, because its state was none that this robot can "
            "have: robot file, units or sensors are wrong"
        )
    return tuple(Note(text, "warning") for text in found)


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
