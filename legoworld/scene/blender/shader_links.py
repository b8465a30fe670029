"""Following shader links to a socket's source, through reroutes and node groups."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import bpy


class UnreadableAlphaError(Exception):
    """The shader graph is outside the rule of `materials`."""


@dataclass(frozen=True)
class Feed:
    """The source of a socket.

    node and output: the node and its output socket; None where nothing is linked, and then
    `socket` is the one whose own value counts. groups: the group nodes the node lies in.
    """

    socket: Any
    node: Any
    output: Any
    groups: tuple[Any, ...]

    def input(self, name: str | int) -> Feed:
        """What feeds one of the node's inputs."""
        return find_feed(self.node.inputs[name], self.groups)

    def value(self) -> float:
        """The value of an unlinked socket, or of a Value node."""
        if self.node is None:
            return float(self.socket.default_value)
        return float(self.output.default_value)

    @property
    def is_constant(self) -> bool:
        """Whether `value` may be asked."""
        return self.node is None or self.node.type == "VALUE"


def find_feed(socket: bpy.types.NodeSocket, groups: tuple[Any, ...] = ()) -> Feed:
    """What feeds a socket of a node that lies in those groups. Raises UnreadableAlphaError."""
    while socket.is_linked:
        link = socket.links[0]
        node = link.from_node
        if link.is_muted or node.mute:
            raise UnreadableAlphaError("a muted node or link decides its alpha")
        if node.type == "REROUTE":
            socket = node.inputs[0]
        elif node.type == "GROUP" and node.node_tree is not None:
            groups = (*groups, node)
            socket = _group_result(node, link.from_socket.identifier)
        elif node.type == "GROUP_INPUT" and groups:
            socket = _find_socket(groups[-1].inputs, link.from_socket.identifier)
            groups = groups[:-1]
        else:
            return Feed(socket, node, link.from_socket, groups)
    return Feed(socket, None, None, groups)


def _group_result(group: bpy.types.ShaderNodeGroup, identifier: str) -> Any:
    for node in group.node_tree.nodes:
        if node.type == "GROUP_OUTPUT" and node.is_active_output:
            return _find_socket(node.inputs, identifier)
    raise UnreadableAlphaError(f"the node group {group.node_tree.name!r} has no output")


def _find_socket(sockets: Iterable[bpy.types.NodeSocket], identifier: str) -> Any:
    for socket in sockets:
        if socket.identifier == identifier:
            return socket
    raise UnreadableAlphaError("a node group's socket leads nowhere")
