"""A node inside the test process that publishes, listens and calls services."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

# What is sent in the moment between our seeing the other side and its seeing us is lost.
_SETTLE_TIME = 0.2  # s


class Probe:
    """One node, one kept executor, spun only while the test waits for something.

    Parameters
    ----------
    domain
        ROS domain id.
    name
        Node name.
    """

    def __init__(self, domain: int, name: str = 'probe') -> None:
        self.context = Context()
        self.context.init(domain_id=domain)
        self.node = Node(name, context=self.context, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._clients: dict[str, Client] = {}
        self._settled: set[str] = set()

    def until(self, condition: Callable[[], Any], timeout: float, what: str) -> Any:
        """Spin until `condition()` is true and return its value."""
        deadline = time.monotonic() + timeout
        while not (value := condition()):
            if time.monotonic() > deadline:
                raise AssertionError(f'waited {timeout} s in vain for {what}')
            self._executor.spin_once(timeout_sec=0.02)
        return value

    def spin_for(self, duration: float) -> None:
        """Spin for `duration` seconds, to see that something does *not* happen."""
        deadline = time.monotonic() + duration
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.02)

    def listen(self, message_type: Any, topic: str, qos: QoSProfile | int = 10) -> list[Any]:
        """Subscribe and return the list that every received message is appended to."""
        received: list[Any] = []
        self.node.create_subscription(message_type, topic, received.append, qos)
        return received

    def publisher(
        self, message_type: Any, topic: str, qos: QoSProfile | int = 10, *, timeout: float = 30.0
    ) -> Any:
        """Create a publisher and wait until somebody listens."""
        publisher = self.node.create_publisher(message_type, topic, qos)
        self.until(publisher.get_subscription_count, timeout, f'a subscriber of {topic}')
        self.spin_for(_SETTLE_TIME)
        return publisher

    def client(self, service_type: Any, name: str, *, timeout: float = 60.0) -> Client:
        """Return the one client of a service as soon as the service can be asked."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(service_type, name)
        client = self._clients[name]
        if name not in self._settled or not client.service_is_ready():
            self.until(client.service_is_ready, timeout, f'service {name}')
            self.spin_for(_SETTLE_TIME)
            self._settled.add(name)
        return client

    def call(self, service_type: Any, name: str, request: Any, *, timeout: float = 60.0) -> Any:
        """Call a service as soon as it exists and return its response."""
        future = self.client(service_type, name, timeout=timeout).call_async(request)
        self.until(future.done, timeout, f'the answer of {name}')
        return future.result()

    def close(self) -> None:
        """Destroy the node and leave the domain."""
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()
