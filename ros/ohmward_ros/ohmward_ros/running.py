"""The process of `ohmward run` on one node of rclpy, and its log on /rosout."""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
from typing import Any

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.signals import SignalHandlerOptions

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.assembly import assemble
from ohmward.onboard.part import LOG
from ohmward.onboard.process import Process
from ohmward.onboard.ros.transport import require_others_topics, require_topics
from ohmward_ros.node import End
from ohmward_ros.parameters import IN, OUT, PARAMETERS, descriptor_of
from ohmward_ros.settings import setup_of

#: Exit status where the node cannot begin.
REFUSED = 1


def run(end: End) -> int:
    """Run until the node is stopped; the exit status."""
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node("ohmward")
    except RuntimeError as error:  # arguments that are none, names that cannot be
        return _refuse(error)
    LOG.setLevel(logging.INFO)
    LOG.addHandler(RosoutHandler(node))
    LOG.propagate = False
    try:
        process = assemble(setup_of(read_parameters(node), node.get_name(), node.get_namespace()), node)
        process.estimation.compile()
        asyncio.run(_run(process, end))
    except OhmwardError as error:
        return _refuse(error)
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        node.destroy_node()
        rclpy.shutdown()
    return 0


def read_parameters(node: Any) -> dict[str, Any]:
    """Values of the parameters by name, which are declared on the node.

    Raises:
        InputError: a value of another type, or a topic that cannot be; with its namespace and remaps the node would
            hear what it sends.
    """
    found: dict[str, Any] = {"use_sim_time": node.get_parameter("use_sim_time").value}
    for name, (default, _) in PARAMETERS.items():
        try:
            found[name] = node.declare_parameter(name, default, descriptor_of(name)).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            given = node._parameter_overrides[name].value
            raise InputError(f"parameter {name} must be {_kind(default, given)}, got {given!r}") from error
    require_topics({name: found[name] for name in (*IN, *OUT)})
    heard, sent = ({n: node.resolve_topic_name(found[n]) for n in names if found[n]} for names in (IN, OUT))
    require_others_topics(heard, sent)
    return found


def _kind(default: Any, given: object) -> str:
    """Type of a parameter in words, with the fix."""
    if isinstance(default, str):
        return f"text: -p \"PARAMETER:='{given}'\""
    if isinstance(default, float):
        return "a number with a point: 5.0, not 5"
    if isinstance(default, bool):
        return "true or false"
    return f"a list like {default}"


def _refuse(error: Exception) -> int:
    print(f"ohmward: error: {error}", file=sys.stderr)
    return REFUSED


class RosoutHandler(logging.Handler):
    """The log of the process as that of its node: on the terminal, in the files of ROS and on /rosout."""

    def __init__(self, node: Any):
        super().__init__()
        self._logger = node.get_logger()

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a record on; rclpy wants a line of code for each severity."""
        text = self.format(record)
        if record.levelno >= logging.ERROR:
            self._logger.error(text)
        elif record.levelno >= logging.WARNING:
            self._logger.warning(text)
        else:
            self._logger.info(text)


async def _run(process: Process, end: End) -> None:
    process.stop_on_signals()
    if not end.asked:
        await process.run()
