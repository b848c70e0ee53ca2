"""A robot on four wheels in MuJoCo, whose contact and rigid-body dynamics are independent of ours.

Needs the extra `sim`; MuJoCo is imported when a plant is made, not before.
"""

from ohmward_lab.simulate.mujoco_plant.ground import Ground, switching, uniform, zones
from ohmward_lab.simulate.mujoco_plant.parameters import FRONT_AND_REAR, RlmaParameters
from ohmward_lab.simulate.mujoco_plant.plant import RlmaPlant, drive

__all__ = [
    "FRONT_AND_REAR",
    "Ground",
    "RlmaParameters",
    "RlmaPlant",
    "drive",
    "switching",
    "uniform",
    "zones",
]
