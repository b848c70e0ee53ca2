"""Robot from a URDF, as used by ROS: wheels, masses and joints.

Wheels are links on `continuous` joints about a horizontal axis that stand on the ground. Those that also swivel, on a
joint about the vertical, count as casters (a steered axle too), and so do links with "caster" in their name.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from ohmward.errors import InputError
from ohmward.traction.robot.chassis import Omni, SkidSteer, TwoWheeled
from ohmward.traction.robot.packaged import AXLE, WHEEL_MASS, WIDTH, generic_motor
from ohmward.traction.robot.robot import MOST_YAW, Robot, Wheel, solid_box_yaw_inertia

#: An axis is horizontal if its upward component is below this, lateral if its forward component is.
_MOST_TILT = 0.2
#: A wheel stands on the ground if its lowest point is above that of the lowest wheel by no more than this share of its
#: radius; radii that differ by no more are equal; casters closer than this [m] along the robot count as one.
_SAME_SHARE = 0.1
#: Names of the elements of an inertia, row by row of its upper half.
_UPPER = ("xx", "xy", "xz", "yy", "yz", "zz")


class UrdfRobot(NamedTuple):
    """Contents of a URDF."""

    robot: Robot
    joints: dict[str, str]  #: driven wheel -> joint
    imu_rpy: dict[
        str, tuple[float, float, float]
    ]  #: link of an inertial unit that is mounted at an angle -> roll, pitch, yaw [rad]
    assumed: tuple[str, ...]  #: assumptions, as sentences


@dataclass(frozen=True)
class _Link:
    """A link in the frame of the root, x forward and z up."""

    name: str
    at_m: np.ndarray  #: (3,)
    frame: np.ndarray  #: (3, 3)
    swivels: bool  #: about the vertical
    joint: str = ""  #: of type continuous, about a horizontal axis
    axis: np.ndarray = field(default_factory=lambda: np.zeros(3))  #: (3,) of that joint
    mass_kg: float = 0.0
    centre_m: np.ndarray = field(default_factory=lambda: np.zeros(3))  #: (3,) of gravity
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))  #: [kg m2] about the centre of gravity
    radius_m: float = math.nan
    width_m: float = math.nan


def read_urdf(path: str | PathLike[str], radius_m: float | None = None, mass_kg: float | None = None) -> UrdfRobot:
    """Robot of a URDF: chassis, wheels, mass and yaw inertia; motors as `generic_motor`.

    radius_m: of the wheels, > 0, if the file has only meshes for them.
    mass_kg: of the robot, > 0, if it is not the sum of the links' masses.

    Raises:
        InputError: not a URDF, no wheels of a supported layout, or missing sizes; says which.
    """
    root = _root(path)
    try:
        links = list(_links(root, str(path)))
    except ValueError as error:  # a mass or a radius
        raise InputError(f"{path}: a number is none: {error}") from error
    wheels = _wheels(links, radius_m, str(path))
    driven = [wheel for wheel in wheels if not wheel.swivels]
    radius = radius_m or float(np.mean([wheel.radius_m for wheel in driven]))
    total_kg = sum(link.mass_kg for link in links)
    if not (mass_kg or total_kg) > 0:
        raise InputError(f"{path}: its links have no masses; give the robot's with --mass (mass_kg=)")
    assumed = ["motors: a URDF has none; usual ones for the mass are assumed, so their currents give no forces yet"]
    if total_kg > 0:
        centre_m = np.average([link.centre_m for link in links], axis=0, weights=[link.mass_kg for link in links])
        square_m2 = sum(_about_vertical(link, centre_m) for link in links) / total_kg
    else:
        centre_m, square_m2 = np.mean([wheel.at_m for wheel in wheels], axis=0), 0.0
    chassis, names, words = _chassis(driven, _casters(links, wheels), float(centre_m[0]), str(path))
    assumed += words
    farthest_m = max(float(np.hypot(*(wheel.at_m - centre_m)[:2])) for wheel in wheels)
    if not 0 < square_m2 <= MOST_YAW * farthest_m**2:
        length, width, _ = np.ptp([wheel.at_m for wheel in wheels], axis=0).tolist()
        square_m2 = solid_box_yaw_inertia(1.0, max(length, width), width)
        assumed.append("yaw inertia: that of a uniform box, as the links have none that their mass allows")
    wheel, words = _wheel(driven, radius, mass_kg or total_kg)
    assumed += words
    assumed += [
        f"joint {link.joint}: its axis points right, so that its speed is < 0 when the robot drives ahead; change the "
        "sign of that signal"
        for link in driven
        if link.axis[1] < 0
    ]
    robot = Robot(
        name=root.get("name") or Path(path).stem,
        mass_kg=mass_kg or total_kg,
        yaw_inertia_kg_m2=(mass_kg or total_kg) * square_m2,
        chassis=chassis,
        wheel=wheel,
        motor=generic_motor(mass_kg or total_kg, radius, len(driven)),
        height_m=max(0.0, float(centre_m[2] - driven[0].at_m[2]) + radius) if total_kg > 0 else 0.0,
    )
    joints = dict(zip(names, (wheel.joint for wheel in driven), strict=True))
    units = [link for link in links if "imu" in link.name.lower()]
    turned = {
        unit.name: roll_pitch_yaw(unit.frame) for unit in units if not np.allclose(unit.frame, np.eye(3), atol=1e-3)
    }
    return UrdfRobot(robot, joints, turned, tuple(assumed))


def _wheel(driven: Sequence[_Link], radius_m: float, mass_kg: float) -> tuple[Wheel, list[str]]:
    """Mean of the wheels, and what was assumed; a uniform disc unless the inertia is one that their mass can have."""
    widths = [wheel.width_m for wheel in driven if math.isfinite(wheel.width_m)]
    inertia = float(np.mean([wheel.axis @ wheel.inertia @ wheel.axis for wheel in driven]))
    at_rim = (float(np.mean([wheel.mass_kg for wheel in driven])) or WHEEL_MASS * mass_kg) * radius_m**2
    words = []
    if not 0 < inertia <= at_rim:
        inertia = at_rim / 2
        words.append("inertia of the wheels: that of a uniform disc, as the links have none that their mass allows")
    return Wheel(radius_m, float(np.mean(widths)) if widths else WIDTH * radius_m, inertia), words


def _root(path: str | PathLike[str]) -> ElementTree.Element:
    """Root element `robot` of a file without macros."""
    try:
        text = Path(path).read_text(encoding="utf-8")
        if "<!DOCTYPE" in text:
            raise InputError(f"{path}: a document type is not read; take it out")
        root = ElementTree.fromstring(text)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is no text in UTF-8") from error
    except ElementTree.ParseError as error:
        raise InputError(f"{path}: is no XML: {error}") from error
    if root.tag != "robot":
        raise InputError(f"{path}: is no URDF: its first element is <{root.tag}>, not <robot>")
    if "${" in text or "$(" in text or any("xacro" in element.tag for element in root.iter()):
        raise InputError(f"{path}: has macros; expand them first: xacro {path} > robot.urdf")
    return root


def _links(root: ElementTree.Element, path: str) -> Iterator[_Link]:
    """Every link in the frame of the root, in the order of the tree."""
    elements = {link.get("name", ""): link for link in root.findall("link")}
    children: dict[str, list[ElementTree.Element]] = {}
    for joint in root.findall("joint"):
        children.setdefault(_of(joint, "parent", "link"), []).append(joint)
    below = {_of(joint, "child", "link") for joints in children.values() for joint in joints}
    roots = [name for name in elements if name not in below]
    if len(roots) != 1:
        raise InputError(f"{path}: one link must be nobody's child, found {len(roots)}: {', '.join(roots) or 'none'}")
    waiting = [_link(elements.pop(roots[0]), np.zeros(3), np.eye(3), False)]
    while waiting:
        link = waiting.pop()
        yield link
        for joint in children.get(link.name, ()):
            name = _of(joint, "child", "link")
            if name not in elements:
                raise InputError(
                    f"{path}: joint {joint.get('name')!r} leads to {name!r}, no link or that of another one"
                )
            at_m, frame = _moved(joint.find("origin"), link.at_m, link.frame)
            turns = joint.get("type") in ("continuous", "revolute")
            axis = frame @ _direction(_of(joint, "axis", "xyz") or "1 0 0") if turns else None
            upright = axis is not None and abs(axis[2]) > 1.0 - _MOST_TILT
            wheel_axis = axis if joint.get("type") == "continuous" and not upright else None
            joint_name = joint.get("name", "") if wheel_axis is not None else ""
            waiting.append(_link(elements.pop(name), at_m, frame, link.swivels or upright, joint_name, wheel_axis))


def _link(
    element: ElementTree.Element,
    at_m: np.ndarray,
    frame: np.ndarray,
    swivels: bool,
    joint: str = "",
    axis: np.ndarray | None = None,
) -> _Link:
    """Link with mass and size from its element."""
    link = _Link(element.get("name", ""), at_m, frame, swivels, joint, np.zeros(3) if axis is None else axis)
    inertial = element.find("inertial")
    if inertial is not None:
        centre_m, turned = _moved(inertial.find("origin"), at_m, frame)
        xx, xy, xz, yy, yz, zz = (float(_of(inertial, "inertia", f"i{ij}") or 0.0) for ij in _UPPER)
        own = turned @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turned.T
        link = replace(link, mass_kg=float(_of(inertial, "mass", "value") or 0.0), centre_m=centre_m, inertia=own)
    for shape in (*element.findall("collision/geometry/*"), *element.findall("visual/geometry/*")):
        if shape.tag in ("cylinder", "sphere"):
            radius_m, width_m = (float(shape.get(size, "nan")) for size in ("radius", "length"))
            return replace(link, radius_m=radius_m, width_m=width_m)
    return link


def _wheels(links: Sequence[_Link], radius_m: float | None, path: str) -> list[_Link]:
    """Links that roll on the ground, left before right, from front to rear."""
    rolling = [link for link in links if link.joint and abs(link.axis[2]) < _MOST_TILT]
    sized = [link for link in rolling if link.radius_m > 0 or radius_m]
    if rolling and not sized:
        raise InputError(f"{path}: has only meshes of its wheels; give their radius with --radius (radius_m=)")
    bottoms = [link.at_m[2] - (radius_m or link.radius_m) for link in sized]
    found = [
        link
        for link, bottom in zip(sized, bottoms, strict=True)
        if bottom - min(bottoms) <= _SAME_SHARE * (radius_m or link.radius_m)
    ]
    driven = [link for link in found if not link.swivels]
    if len(driven) < 2:
        raise InputError(
            f"{path}: has no two wheels on joints of type continuous that do not swivel; give sizes instead: "
            "--radius, --track and --mass"
        )
    radii = [link.radius_m for link in driven if link.radius_m > 0]
    if not radius_m and max(radii) > (1.0 + _SAME_SHARE) * min(radii):
        raise InputError(
            f"{path}: its wheels have radii from {min(radii):g} to {max(radii):g} m, and ohmward needs "
            "equal ones; give that of the driven wheels with --radius (radius_m=)"
        )
    return sorted(found, key=lambda link: (-round(link.at_m[0], 3), -link.at_m[1]))


def _casters(links: Sequence[_Link], wheels: Sequence[_Link]) -> list[float]:
    """Positions of the casters along the robot [m], each once."""
    names = {wheel.name for wheel in wheels}
    swivelling = [wheel.at_m[0] for wheel in wheels if wheel.swivels]
    called = [link.at_m[0] for link in links if "caster" in link.name.lower() and link.name not in names]
    found: list[float] = []
    for place in sorted(swivelling or called):
        if not found or place - found[-1] > _SAME_SHARE:
            found.append(float(place))
    return found


def _chassis(
    driven: Sequence[_Link], casters_m: list[float], centre_m: float, path: str
) -> tuple[SkidSteer | TwoWheeled | Omni, list[str], list[str]]:
    """Layout of the wheels about the centre of gravity at `centre_m`, names of the driven ones, and assumptions."""
    x, y = np.array([wheel.at_m[:2] for wheel in driven]).T
    if len(driven) == 2:
        chassis, words = _two_wheeled(float(x.mean()), float(np.ptp(y)), casters_m, centre_m)
        return chassis, ["left", "right"], words
    lateral = all(abs(wheel.axis[0]) < _MOST_TILT for wheel in driven)
    if not lateral:
        x, y = x - x.mean(), y - y.mean()
        bearings = np.degrees(np.arctan2(y, x)) % 360.0
        order = np.argsort(bearings)
        omni = Omni(float(np.hypot(x, y).mean()), tuple(bearings[order].round(3).tolist()))
        return omni, [f"wheel_{k}" for k in 1 + np.argsort(order)], []
    if len(driven) == 4:
        front, rear = float(x.max()), float(x.min())
        words = ['all four wheels are assumed to be driven; without motors at one axle use kind = "differential"']
        if not rear < centre_m < front:
            centre_m = 0.5 * (front + rear)
            words.append("centre of gravity: in the middle of the axles, as the masses put it outside of them")
        skid_steer = SkidSteer(front - centre_m, centre_m - rear, float(np.ptp(y)))
        return skid_steer, ["front_left", "front_right", "rear_left", "rear_right"], words
    raise InputError(
        f"{path}: has {len(driven)} driven wheels; ohmward knows two with casters, four on two axles, and omni-wheels; "
        "give sizes instead: --radius, --track and --mass"
    )


def _two_wheeled(
    axle_m: float, track_m: float, casters_m: list[float], centre_m: float
) -> tuple[TwoWheeled, list[str]]:
    """Two driven wheels and casters, and the assumptions made."""
    words = []
    if not casters_m:
        casters_m = [axle_m - track_m]
        words.append("caster: none found; taken one track behind the axle")
    try:
        return TwoWheeled(axle_m - centre_m, track_m, tuple(place - centre_m for place in casters_m)), words
    except InputError:  # it tips over
        farthest = max(casters_m, key=lambda place: abs(place - axle_m))
        centre_m = axle_m + AXLE * (farthest - axle_m)
        words.append(
            "centre of gravity: a quarter of the way from axle to caster; where the masses put it, the robot tips over"
        )
        return TwoWheeled(axle_m - centre_m, track_m, tuple(place - centre_m for place in casters_m)), words


def _about_vertical(link: _Link, centre: np.ndarray) -> float:
    """Yaw inertia [kg m2] of a link about the vertical through the centre of gravity."""
    return float(link.inertia[2, 2] + link.mass_kg * np.sum((link.centre_m - centre)[:2] ** 2))


def _moved(origin: ElementTree.Element | None, at_m: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and frame after an element `origin`, from the position and frame before it."""
    if origin is None:
        return at_m, frame
    turned = rotation(*_numbers(origin.get("rpy", "0 0 0")))
    return at_m + frame @ _numbers(origin.get("xyz", "0 0 0")), frame @ turned


def rotation(roll_rad: float, pitch_rad: float, yaw_rad: float) -> np.ndarray:
    """Rotation (3, 3) from the frame of a part to the frame that it is mounted in: R_z(yaw) R_y(pitch) R_x(roll)."""
    (cr, cp, cy), (sr, sp, sy) = (f([roll_rad, pitch_rad, yaw_rad]) for f in (np.cos, np.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def roll_pitch_yaw(frame: np.ndarray) -> tuple[float, float, float]:
    """Roll, pitch and yaw [rad] of a (3, 3) made by `rotation`; the roll is 0 where the nose points up or down."""
    pitch_rad = math.atan2(-frame[2, 0], math.hypot(frame[0, 0], frame[1, 0]))
    if math.cos(pitch_rad) < 1e-6:
        return 0.0, pitch_rad, math.atan2(-frame[0, 1], frame[1, 1])
    return math.atan2(frame[2, 1], frame[2, 2]), pitch_rad, math.atan2(frame[1, 0], frame[0, 0])


def _numbers(text: str) -> np.ndarray:
    """Three numbers of an attribute."""
    try:
        found = np.array([float(word) for word in text.split()])
    except ValueError:
        found = np.empty(0)
    if found.shape != (3,) or not np.all(np.isfinite(found)):
        raise InputError(f"a URDF has three numbers in xyz, rpy and axis, got {text!r:.60}")
    return found


def _direction(text: str) -> np.ndarray:
    """A direction (3,) of length 1."""
    found = _numbers(text)
    if not found.any():
        raise InputError("a URDF's axis must not be 0 0 0")
    return found / np.linalg.norm(found)


def _of(element: ElementTree.Element, child: str, attribute: str) -> str:
    """Attribute of an element's child; "" if it is missing."""
    found = element.find(child)
    return "" if found is None else found.get(attribute, "")
