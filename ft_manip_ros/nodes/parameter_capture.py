"""What the recorded nodes were told: their parameters and the arm files those name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import qos_profile_parameters

from ft_manip_ros.core.config_files import find_config
from ft_manip_ros.core.errors import InputError

# Parameters that name a file on which the node's decisions rest.
_FILES = ('arm', 'obstacles', 'srdf')


class ParameterCapture:
    """Asks each named node once for all its parameters, when it appears.

    Later changes are on ``/parameter_events``.

    Parameters
    ----------
    node
        Who asks.
    wanted
        Says of a node name (without namespace) whether to ask it.
    note
        Called with (full node name, parameter values as YAML by name).
    attach
        Called with (name, media type, content) of each file that a parameter ``arm``,
        ``obstacles`` or ``srdf`` names.
    """

    def __init__(
        self,
        node: Node,
        wanted: Callable[[str], bool],
        note: Callable[[str, dict[str, str]], None],
        attach: Callable[[str, str, bytes], None],
    ) -> None:
        self._node = node
        self._wanted = wanted
        self._note = note
        self._attach = attach
        self._known: set[str] = set()
        self._waiting: dict[str, tuple[Client, Client]] = {}
        self._clients: list[Client] = []

    def discover(self) -> None:
        """Ask the nodes that are new, as soon as they are ready to answer."""
        for name, namespace in self._node.get_node_names_and_namespaces():
            full = f'{namespace.rstrip("/")}/{name}'
            if self._wanted(name) and full not in self._known:
                self._known.add(full)
                # Their queue is long enough for one answer per parameter; the usual one is not.
                clients = (
                    self._client(ListParameters, f'{full}/list_parameters'),
                    self._client(GetParameters, f'{full}/get_parameters'),
                )
                self._clients.extend(clients)
                self._waiting[full] = clients
        for full, clients in list(self._waiting.items()):
            if all(client.service_is_ready() for client in clients):
                del self._waiting[full]
                self._ask(full, *clients)

    def close(self) -> None:
        """Forget the questions that are open."""
        for client in self._clients:
            self._node.destroy_client(client)
        self._clients.clear()
        self._waiting.clear()

    def _client(self, kind: Any, name: str) -> Client:
        return self._node.create_client(kind, name, qos_profile=qos_profile_parameters)

    def _ask(self, full: str, list_client: Client, get_client: Client) -> None:
        future = list_client.call_async(ListParameters.Request())
        future.add_done_callback(lambda done: self._on_names(full, done.result(), get_client))

    def _on_names(self, full: str, response: Any, client: Client) -> None:
        names = list(response.result.names) if response is not None else []
        found: dict[str, Any] = {}
        missing = set(names)
        # One by one: a node answers a list with nothing at all if one of them has no value.
        for name in names:
            future = client.call_async(GetParameters.Request(names=[name]))

            def collect(done: Any, name: str = name) -> None:
                if done.result() is not None and done.result().values:
                    found[name] = parameter_value_to_python(done.result().values[0])
                missing.discard(name)
                if not missing:
                    self._on_values(full, found)

            future.add_done_callback(collect)

    def _on_values(self, full: str, found: dict[str, Any]) -> None:
        self._note(full, {name: _as_yaml(value) for name, value in sorted(found.items())})
        for kind in _FILES:
            if isinstance(found.get(kind), str) and found[kind]:
                self._attach_file(kind, full, found[kind])

    def _attach_file(self, kind: str, full: str, named: str) -> None:
        try:
            path = find_config('arms', named) if kind == 'arm' else Path(named).expanduser()
            content = Path(path).read_bytes()
        except (InputError, OSError):
            return  # the node itself has said so
        text = 'yaml' if path.suffix in ('.yaml', '.yml') else 'xml'
        self._attach(f'{kind}{full}{path.suffix}', f'application/{text}', content)


def _as_yaml(value: Any) -> str:
    if hasattr(value, 'tolist'):
        value = value.tolist()
    if isinstance(value, (tuple, list)):
        value = list(value)
    return (
        yaml.safe_dump(value, default_flow_style=True, width=10**6).removesuffix('\n...\n').strip()
    )
