"""ohmward: state of charge, wheel slip and range of battery-powered robots, with uncertainties that hold.

The names in `__all__` are what scripts and notebooks need; each is loaded when it is first used (PEP 562), so that
`import ohmward` costs nothing and a robot loads only what it runs.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ohmward.battery.battery import Battery as Battery
    from ohmward.battery.file import load_battery as load_battery
    from ohmward.battery.file import save_battery as save_battery
    from ohmward.battery.identification import identify as identify
    from ohmward.battery.soc.estimator import SocEstimator as SocEstimator
    from ohmward.battery.soc.registry import EstimatorSettings as EstimatorSettings
    from ohmward.battery.soc.sample import SocEstimate as SocEstimate
    from ohmward.battery.soc.sample import SocFlag as SocFlag
    from ohmward.battery.soc.sample import SocSample as SocSample
    from ohmward.battery.soc.score import score as score
    from ohmward.errors import InputError as InputError
    from ohmward.errors import OhmwardError as OhmwardError
    from ohmward.figures.plot import plot as plot
    from ohmward.logs import Log as Log
    from ohmward.logs import examine as examine
    from ohmward.logs import read_log as read_log
    from ohmward.logs import write_log as write_log
    from ohmward.logs import write_table as write_table
    from ohmward.published.registry import available as available
    from ohmward.published.registry import make_estimator as make_estimator
    from ohmward.simulate import make_robot_day as make_robot_day
    from ohmward.traction.speed_observer.track import SlipEstimator as SlipEstimator

__version__ = "0.1.0"

_HOMES = {
    "Battery": "battery.battery",
    "SocEstimate": "battery.soc.sample",
    "SocFlag": "battery.soc.sample",
    "InputError": "errors",
    "Log": "logs",
    "OhmwardError": "errors",
    "SocSample": "battery.soc.sample",
    "EstimatorSettings": "battery.soc.registry",
    "SlipEstimator": "traction.speed_observer.track",
    "SocEstimator": "battery.soc.estimator",
    "available": "published.registry",
    "examine": "logs",
    "identify": "battery.identification",
    "load_battery": "battery.file",
    "make_estimator": "published.registry",
    "make_robot_day": "simulate",
    "plot": "figures.plot",
    "read_log": "logs",
    "save_battery": "battery.file",
    "score": "battery.soc.score",
    "write_log": "logs",
    "write_table": "logs",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    """Load a public name from its home, once."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, loaded or not."""
    return sorted({*globals(), *__all__})
