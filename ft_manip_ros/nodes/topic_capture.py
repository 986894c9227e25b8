"""Subscriptions of the recorder: found at run time, QoS as offered, bytes as they come."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.subscription import Subscription

from ft_manip_ros.bags.definitions import split_type_name
from ft_manip_ros.bags.qos import QosProfile
from ft_manip_ros.bags.recording import Recorded
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.nodes.loss_count import LossCount

# Deep enough for a burst of a kHz topic between two polls.
_DEPTH = 2000


class PolledGroup(CallbackGroup):
    """Keeps subscriptions out of the executor: whoever owns them takes the messages.

    A wake-up per message costs the executor ten times what taking the message does.
    """

    def can_execute(self, entity: Any) -> bool:
        """Nothing here is the executor's."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Nothing here is the executor's."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing here is the executor's."""


@dataclass
class _Captured:
    subscription: Subscription
    reliable: bool
    latched: bool
    losses: LossCount = field(default_factory=LossCount)


def message_class(type_name: str) -> Any:
    """Python class of a message or service event type.

    Raises
    ------
    InputError
        If the type's package is not installed here.
    """
    package, kind, name = split_type_name(type_name)
    try:
        module = importlib.import_module(f'{package}.{kind}')
        if kind == 'srv' and name.endswith('_Event'):
            return getattr(module, name.removesuffix('_Event')).Event
        return getattr(module, name)
    except (ImportError, AttributeError):
        raise InputError(f'type {type_name!r}', 'has no Python support on this machine') from None


class TopicCapture:
    """Follows the graph and takes every message of the wanted topics.

    Parameters
    ----------
    node
        Whose subscriptions these are.
    wanted
        Says of a resolved topic name whether to record it.
    announce
        Called with (topic, type name, offered QoS) before a topic's first message.
    complain
        Called with (topic, text) when a topic cannot be recorded.
    clock
        Time (ns) to stamp messages with, where that of their arrival is another clock's: for
        use_sim_time. None: the time of arrival, as the middleware noted it.
    """

    def __init__(
        self,
        node: Node,
        wanted: Callable[[str], bool],
        announce: Callable[[str, str, tuple[QosProfile, ...]], None],
        complain: Callable[[str, str], None],
        clock: Callable[[], int] | None = None,
    ) -> None:
        self._node = node
        self._wanted = wanted
        self._announce = announce
        self._complain = complain
        self._clock = clock
        self._group = PolledGroup()
        self._captured: dict[tuple[str, str], _Captured] = {}
        self._lost_before = 0

    @property
    def lost(self) -> int:
        """Messages that the middleware lost before they came here."""
        now = sum(captured.losses.lost for captured in self._captured.values())
        return self._lost_before + now

    @property
    def topics(self) -> list[str]:
        """Names of the topics that are subscribed now."""
        return sorted({topic for topic, _ in self._captured})

    def discover(self) -> None:
        """Subscribe to what is new and adapt to publishers that joined, latched topics first."""
        found = []
        for topic, types in self._node.get_topic_names_and_types():
            if not self._wanted(topic):
                continue
            publishers = self._node.get_publishers_info_by_topic(topic)
            for type_name in types:
                offered = [p.qos_profile for p in publishers if p.topic_type == type_name]
                if offered:
                    found.append((topic, type_name, offered))
        found.sort(key=lambda entry: not _all_latched(entry[2]))
        for topic, type_name, offered in found:
            self._adapt(topic, type_name, offered)

    def take(self) -> list[Recorded]:
        """Return all messages that have arrived since the last call, by time of arrival."""
        batch: list[Recorded] = []
        now = self._clock() if self._clock else 0
        for (topic, type_name), captured in self._captured.items():
            subscription = captured.subscription
            with subscription.handle:
                while True:
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                    if taken is None:
                        break
                    data, info = taken
                    captured.losses.note(
                        info['publication_sequence_number'], subscription.get_publisher_count()
                    )
                    arrived = now or info['received_timestamp'] or info['source_timestamp']
                    batch.append(
                        Recorded(topic, type_name, arrived, info['source_timestamp'], data)
                    )
        batch.sort(key=lambda message: (message.log_time, message.publish_time))
        return batch

    def close(self) -> None:
        """Unsubscribe from everything."""
        for key in list(self._captured):
            self._let_go(key)

    def _adapt(self, topic: str, type_name: str, offered: list[QoSProfile]) -> None:
        reliable = all(q.reliability == ReliabilityPolicy.RELIABLE for q in offered)
        latched = _all_latched(offered)
        captured = self._captured.get((topic, type_name))
        # A request stronger than an offer gets nothing; a weaker one only asks for less.
        if captured is not None:
            if captured.reliable <= reliable and captured.latched <= latched:
                return
            self._let_go((topic, type_name))
        self._drop_other_types(topic, type_name)
        try:
            self._announce(topic, type_name, tuple(_profile(qos) for qos in offered))
            subscription = self._node.create_subscription(
                message_class(type_name),
                topic,
                _never_called,
                _request(offered, reliable, latched),
                callback_group=self._group,
                raw=True,
            )
        except InputError as error:
            self._complain(topic, f'{topic} is not recorded: {error}')
            return
        except Exception as error:  # noqa: BLE001 - rcl raises several kinds, none documented
            self._complain(topic, f'{topic} is not recorded as {type_name}: {error}')
            return
        self._captured[topic, type_name] = _Captured(subscription, reliable, latched)

    def _drop_other_types(self, topic: str, type_name: str) -> None:
        """Let go of a type that nobody publishes any more, so that another can take its place."""
        for name, other in list(self._captured):
            if name == topic and other != type_name:
                captured = self._captured[name, other]
                if captured.subscription.get_publisher_count() == 0:
                    self._let_go((name, other))

    def _let_go(self, key: tuple[str, str]) -> None:
        captured = self._captured.pop(key)
        self._lost_before += captured.losses.lost
        self._node.destroy_subscription(captured.subscription)


def _never_called(message: bytes) -> None:
    raise AssertionError('the executor must not take messages of a polled group')


def _all_latched(offered: Iterable[QoSProfile]) -> bool:
    return all(q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in offered)


def _request(offered: list[QoSProfile], reliable: bool, latched: bool) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=max([_DEPTH, *(q.depth for q in offered)]),
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=(DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE),
    )


def _profile(qos: QoSProfile) -> QosProfile:
    def time(duration: Any) -> tuple[int, int]:
        # rcl calls "infinite" what exceeds its own range.
        return divmod(min(duration.nanoseconds, 2**63 - 1), 1_000_000_000)

    def name(policy: Any) -> str:
        return str(policy.name).lower()

    history = qos.history
    return QosProfile(
        # Discovery does not tell a publisher's history: rosbag2 writes 'unknown' too.
        history=name(history) if history != HistoryPolicy.SYSTEM_DEFAULT else 'unknown',
        depth=qos.depth,
        reliability=name(qos.reliability),
        durability=name(qos.durability),
        liveliness=(
            name(qos.liveliness)
            if qos.liveliness != LivelinessPolicy.SYSTEM_DEFAULT
            else 'automatic'
        ),
        deadline=time(qos.deadline),
        lifespan=time(qos.lifespan),
        lease=time(qos.liveliness_lease_duration),
    )
