"""Playing a bag on DDS with /clock, for running nodes with use_sim_time."""

from __future__ import annotations

import time

import rclpy
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from ft_manip_ros.bags.qos import QosProfile
from ft_manip_ros.bags.reader import Bag, BagMessage
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import stamp
from ft_manip_ros.nodes.topic_capture import message_class

# What the nodes take in; what they put out they are to put out again by themselves.
INPUTS = (topics.JOINT_STATES, topics.JOINT_TRAJECTORY, topics.TASK, topics.ROBOT_DESCRIPTION)
_CLOCK_STEP = 10_000_000  # ns of recorded time
_FIRST_TICKS = 10
_WAIT = 10.0  # s, for somebody who listens
_LEAST_DEPTH = 100
_LARGEST_BURST = 0.02  # s of wall time that may be made up for
_LINGER = 0.5  # s, for reliable messages to arrive before the publishers go


def play(bag: Bag, *, rate: float = 1.0, start: int | None = None, end: int | None = None) -> int:
    """Publish the recorded inputs at their recorded times, and /clock.

    Parameters
    ----------
    rate
        Speed; 2 plays twice as fast.
    start, end
        Log times (ns) of the first and last message.

    Returns
    -------
    int
        0, or 1 if nobody listened.

    Raises
    ------
    InputError
        For a bad rate, a bag without any of the inputs, or a message type that is not installed.
    """
    if not 0.0 < rate < float('inf'):
        raise InputError('--rate', f'is {rate}; must be a finite number > 0')
    chosen = [
        topic
        for topic in bag.topics
        if any(topic == name or topic.endswith(f'/{name}') for name in INPUTS)
    ]
    if not any(bag.topics[topic].count for topic in chosen):
        raise InputError(f'bag {bag.path}', f'has none of {", ".join(INPUTS)}')
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node = Node('bag_player')
    try:
        clock = node.create_publisher(Clock, '/clock', QoSProfile(depth=1))
        publishers = {
            topic: node.create_publisher(
                message_class(bag.topics[topic].type_name), topic, _qos(bag.topics[topic].qos)
            )
            for topic in chosen
        }
        if not _somebody_listens(list(publishers.values()), clock):
            print(f'nobody subscribed to {", ".join(publishers)} within {_WAIT:g} s')
            return 1
        count = 0
        pace = _Pace(clock, rate)
        for message in bag.messages(chosen, start=start, end=end):
            pace.advance(message.log_time)
            _publish(publishers[message.topic], message)
            count += 1
        time.sleep(_LINGER)
        print(f'played {count} messages')
        return 0
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


class _Pace:
    """Advances /clock in small steps, never faster than asked.

    Where the machine stutters the recorded time stands still with it: a burst that makes up for
    lost time would overflow the queues of those who listen.
    """

    def __init__(self, clock: Publisher, rate: float) -> None:
        self._clock = clock
        self._rate = rate
        self._origin: tuple[int, float] | None = None
        self._now = 0

    def advance(self, to: int) -> None:
        """Wait until it is ``to`` (ns), telling the time on the way."""
        if self._origin is None:
            # The nodes learn the time before anything happens: a jump of the clock makes them
            # forget what they have just heard.
            for _ in range(_FIRST_TICKS):
                self._clock.publish(Clock(clock=stamp(to)))
                time.sleep(_LINGER / _FIRST_TICKS)
            self._origin, self._now = (to, time.monotonic()), to
        while self._now < to:
            self._now = min(self._now + _CLOCK_STEP, to)
            first, began = self._origin
            left = began + (self._now - first) * 1e-9 / self._rate - time.monotonic()
            if left > 0.0:
                time.sleep(left)
            elif left < -_LARGEST_BURST:
                self._origin = self._now, time.monotonic()
            self._clock.publish(Clock(clock=stamp(self._now)))


def _publish(publisher: Publisher, message: BagMessage) -> None:
    # Bytes are published as they are: nothing is decoded and encoded on the way.
    publisher.publish(message.data)


def _somebody_listens(publishers: list[Publisher], clock: Publisher) -> bool:
    """Wait for the first subscriber, and for those who are found together with it."""
    deadline = time.monotonic() + _WAIT
    known, since = (0, 0), time.monotonic()
    while time.monotonic() < deadline:
        listeners = sum(publisher.get_subscription_count() for publisher in publishers)
        found = listeners, clock.get_subscription_count()
        if found != known:
            known, since = found, time.monotonic()
        elif listeners and time.monotonic() - since > _LINGER:
            break
        time.sleep(0.05)
    return known[0] > 0


def _qos(offered: tuple[QosProfile, ...]) -> QoSProfile:
    """What the recorded publishers offered, with room for a fast replay."""
    reliable = all(profile.reliability != 'best_effort' for profile in offered)
    latched = bool(offered) and all(p.durability == 'transient_local' for p in offered)
    return QoSProfile(
        depth=1 if latched else max([_LEAST_DEPTH, *(p.depth for p in offered)]),
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
