"""ohmward: state of charge, wheel slip and range of battery-powered robots, with uncertainties that hold.

The names in `__all__` are what scripts and notebooks need; each is loaded when it is first used (PEP 562), so that
`import ohmward` costs nothing and a robot loads only what it runs.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ohmward.battery.battery import Battery as Battery
    from ohmward.battery.cells.pack_estimator import PackEstimator as PackEstimator
    from ohmward.battery.chemistries import generic_battery as generic_battery
    from ohmward.battery.file import load_battery as load_battery
    from ohmward.battery.file import save_battery as save_battery
    from ohmward.battery.health.health import health as health
    from ohmward.battery.identification import identify as identify
    from ohmward.battery.learning import learn as learn
    from ohmward.battery.soc.comparison import compare as compare
    from ohmward.battery.soc.estimator import SocEstimator as SocEstimator
    from ohmward.battery.soc.registry import EstimatorSettings as EstimatorSettings
    from ohmward.battery.soc.registry import available as available
    from ohmward.battery.soc.registry import make_estimator as make_estimator
    from ohmward.battery.soc.sample import SocEstimate as SocEstimate
    from ohmward.battery.soc.sample import SocFlag as SocFlag
    from ohmward.battery.soc.sample import SocSample as SocSample
    from ohmward.battery.soc.score import score as score
    from ohmward.embedded.export import export as export
    from ohmward.energy.consumption import Consumption as Consumption
    from ohmward.energy.consumption_file import load_consumption as load_consumption
    from ohmward.energy.consumption_file import save_consumption as save_consumption
    from ohmward.energy.leg import Leg as Leg
    from ohmward.energy.range_estimator import RangeEstimator as RangeEstimator
    from ohmward.energy.range_step import RangeEstimate as RangeEstimate
    from ohmward.energy.range_step import RangeFlag as RangeFlag
    from ohmward.errors import InputError as InputError
    from ohmward.errors import OhmwardError as OhmwardError
    from ohmward.figures.plot import plot as plot
    from ohmward.logs.doctor import examine as examine
    from ohmward.logs.drive_log import DriveLog as DriveLog
    from ohmward.logs.drive_log import read_drive as read_drive
    from ohmward.logs.log import Log as Log
    from ohmward.logs.log import read_log as read_log
    from ohmward.logs.write import write_log as write_log
    from ohmward.logs.write import write_table as write_table
    from ohmward.traction.calibration import calibrate as calibrate
    from ohmward.traction.motion.sample import RobotSample as RobotSample
    from ohmward.traction.odometry.estimator import Odometry as Odometry
    from ohmward.traction.robot.packaged import load_robot as load_robot
    from ohmward.traction.robot.robot import Robot as Robot
    from ohmward.traction.robot.robot import save_robot as save_robot
    from ohmward.traction.speed_observer.estimate import SlipEstimate as SlipEstimate
    from ohmward.traction.speed_observer.estimate import SlipFlag as SlipFlag
    from ohmward.traction.speed_observer.estimator import SlipEstimator as SlipEstimator
    from ohmward_lab.simulate import make_robot_day as make_robot_day

__version__ = "0.1.0"

_HOMES = {
    "Log": "logs.log",
    "DriveLog": "logs.drive_log",
    "read_log": "logs.log",
    "read_drive": "logs.drive_log",
    "examine": "logs.doctor",
    "write_log": "logs.write",
    "write_table": "logs.write",
    "Battery": "battery.battery",
    "identify": "battery.identification",
    "generic_battery": "battery.chemistries",
    "load_battery": "battery.file",
    "save_battery": "battery.file",
    "Robot": "traction.robot.robot",
    "learn": "battery.learning",
    "health": "battery.health.health",
    "compare": "battery.soc.comparison",
    "export": "embedded.export",
    "calibrate": "traction.calibration",
    "load_robot": "traction.robot.packaged",
    "save_robot": "traction.robot.robot",
    "Consumption": "energy.consumption",
    "load_consumption": "energy.consumption_file",
    "save_consumption": "energy.consumption_file",
    "Leg": "energy.leg",
    "SocEstimator": "battery.soc.estimator",
    "PackEstimator": "battery.cells.pack_estimator",
    "SlipEstimator": "traction.speed_observer.estimator",
    "Odometry": "traction.odometry.estimator",
    "RangeEstimator": "energy.range_estimator",
    "SocSample": "battery.soc.sample",
    "SocEstimate": "battery.soc.sample",
    "SocFlag": "battery.soc.sample",
    "RobotSample": "traction.motion.sample",
    "SlipEstimate": "traction.speed_observer.estimate",
    "SlipFlag": "traction.speed_observer.estimate",
    "RangeEstimate": "energy.range_step",
    "RangeFlag": "energy.range_step",
    "EstimatorSettings": "battery.soc.registry",
    "available": "battery.soc.registry",
    "make_estimator": "battery.soc.registry",
    "plot": "figures.plot",
    "score": "battery.soc.score",
    "make_robot_day": "ohmward_lab.simulate",
    "InputError": "errors",
    "OhmwardError": "errors",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    """Load a public name from its module on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = _HOMES[name]
    value = getattr(import_module(home if home.startswith("ohmward") else f"{__name__}.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, loaded or not."""
    return sorted({*globals(), *__all__})
