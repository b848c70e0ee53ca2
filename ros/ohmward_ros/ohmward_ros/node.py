"""The node: parameters of ROS around the process of `ohmward run`."""

from __future__ import annotations

import asyncio
import logging
import sys

import rclpy

from ohmward.errors import OhmwardError
from ohmward.onboard.assembly import assemble
from ohmward.onboard.process import Process
from ohmward.onboard.ros.transport import require_others_topics
from ohmward_ros.settings import DEFAULTS, IN, OUT, setup_of


def main() -> None:
    """Run until the node is stopped."""
    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="ohmward: %(message)s")
    try:
        process = assemble(setup_of(*read_parameters()))
        process.estimation.compile()
        asyncio.run(_run(process))
    except OhmwardError as error:
        sys.exit(f"ohmward: error: {error}")


def read_parameters() -> tuple[dict[str, str], str]:
    """Parameters by name, and the namespace of the node.

    Raises:
        InputError: with its namespace and remaps the node would hear what it sends.
    """
    rclpy.init()
    node = rclpy.create_node("ohmward_parameters")
    try:
        found = {name: str(node.declare_parameter(name, default).value) for name, default in DEFAULTS.items()}
        heard, sent = ({n: node.resolve_topic_name(found[n]) for n in names if found[n]} for names in (IN, OUT))
        require_others_topics(heard, sent)
        return found, node.get_namespace()
    finally:
        node.destroy_node()
        rclpy.shutdown()


async def _run(process: Process) -> None:
    process.stop_on_signals()
    await process.run()
