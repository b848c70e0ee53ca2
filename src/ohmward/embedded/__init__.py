"""C99 libraries for microcontrollers: a filter with its build files, test vectors and a README; see docs/export.md."""

from ohmward.embedded.battery import battery_export
from ohmward.embedded.c_library import Export, library, write_library
from ohmward.embedded.export import export
from ohmward.embedded.traction import controller_export, observer_export, odometry_export
from ohmward.embedded.twin import Twin

__all__ = [
    "Export",
    "Twin",
    "battery_export",
    "controller_export",
    "export",
    "library",
    "observer_export",
    "odometry_export",
    "write_library",
]
