"""Sources and sinks of ROS 2 on one node of rclpy, where their settings name the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ohmward.onboard.part import Sink, Source
from ohmward.onboard.ros.transport import SharedNode
from ohmward.onboard.sinks.ros2 import Ros2Sink
from ohmward.onboard.sources.ros2 import Ros2Source


@dataclass(frozen=True)
class OnNode:
    """A source or a sink on a node that others use too."""

    takes_all: ClassVar[bool] = True
    signals: ClassVar[tuple[str, ...]] = ()
    part: Ros2Source | Ros2Sink
    node: SharedNode

    @property
    def name(self) -> str:
        """In diagnostics and logs."""
        return self.part.name

    @property
    def live(self) -> bool:
        """As of the source."""
        return getattr(self.part, "live", True)

    @property
    def interval_s(self) -> float:
        """As of the sink."""
        return getattr(self.part, "interval_s", 0.0)

    async def run(self, other: Any) -> None:
        """Run the source or the sink, with what it takes."""
        async with self.node.opened() as transport:
            await self.part.run_on(transport, other)


def on_one_node(
    sources: Sequence[Source], sinks: Sequence[Sink], node: Any = None
) -> tuple[Sequence[Source], Sequence[Sink]]:
    """The sources and sinks of a process; those with the same node, namespace and domain share it.

    node: of rclpy that there is already, for all of them.
    """
    nodes: dict[tuple[object, ...], SharedNode] = {}

    def shared(part: Any) -> Any:
        if not isinstance(part, Ros2Source | Ros2Sink) or not (part.uses_rclpy or node is not None):
            return part
        key = () if node is not None else (part.node, part.namespace, part.domain)
        return OnNode(part, nodes.setdefault(key, SharedNode(part, node)))

    return [shared(source) for source in sources], [shared(sink) for sink in sinks]
