"""The base of every node: a lifecycle node that can start itself and never dies of bad input."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.service_introspection import ServiceIntrospectionState
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from ft_manip_ros.core.errors import InputError
from ft_manip_ros.nodes.loss_count import LossCount
from ft_manip_ros.nodes.parameters import AUTOSTART, ParameterSpec, declare, read
from ft_manip_ros.nodes.topics import SERVICE_EVENT_QOS

# A broken publisher at 100 Hz must not fill the log: one line a second for each source.
_COMPLAINT_PERIOD = 1.0

# How a service of an inactive node answers, after the node's name.
NOT_ACTIVE = 'is not active'


class ManagedNode(LifecycleNode):
    """A lifecycle node whose subclasses fill in `configure`, `activate`, `deactivate`, `release`.

    Everything created in `configure` or `activate` through this class or rclpy (publishers,
    subscriptions, services, clients, timers) is destroyed on cleanup. Callbacks made by
    `subscribe`, `serve` and `every` run only while the node is active; an `InputError` in them
    is logged (or answered) and leaves the node as it was.

    Parameters
    ----------
    name
        Node name.
    parameters
        What the node can be told; ``autostart`` is added.
    threads
        1: all callbacks one after the other. More: callbacks in callback groups of their own run
        beside the others (see `run`).
    """

    def __init__(
        self, name: str, parameters: Sequence[ParameterSpec] = (), *, threads: int = 1
    ) -> None:
        super().__init__(name)
        self.threads = threads
        self.active = False
        self._specs = {spec.name: spec for spec in (*parameters, AUTOSTART)}
        for spec in self._specs.values():
            declare(self, spec)
        self._complained: dict[str, float] = {}
        self._answer_invalid_transitions()
        self._start_timer: Timer | None = None
        if self.param('autostart'):
            self._start_timer = self.create_timer(0.0, self._autostart)
        self._permanent = set(self._entities())

    # What a subclass fills in

    def configure(self) -> None:
        """Read parameters, load models, create publishers and services.

        Raise `InputError` when that cannot be done: the node then stays unconfigured.
        """

    def warm_up(self) -> None:
        """Compile and touch what callbacks will need; called at the end of configuring."""

    def activate(self) -> None:
        """Start working; publishers are enabled already."""

    def deactivate(self) -> None:
        """Stop working; publishers are still enabled."""

    def release(self) -> None:
        """Let go of everything made in `configure`, also after a `configure` that failed."""

    # What a subclass uses

    def param(self, name: str) -> Any:
        """Return the value of a declared parameter; raises `InputError` where it is unusable."""
        return read(self, self._specs[name])

    def advertise(self, message_type: type, topic: str, qos: QoSProfile) -> LifecyclePublisher:
        """Create a publisher that is silent while the node is inactive."""
        return self.create_lifecycle_publisher(message_type, topic, qos)

    def subscribe(
        self,
        message_type: type,
        topic: str,
        callback: Callable[[Any], None] | Callable[[Any, int], None],
        qos: QoSProfile,
        *,
        timed: bool = False,
        losses: LossCount | None = None,
    ) -> Subscription:
        """Subscribe; messages are ignored while inactive, and bad ones logged.

        A ``timed`` callback is also told when the message came in (ns, of the node's clock), which
        may be long before it is called on a busy machine. ``losses`` counts those that never came.
        """

        def guarded(message: Any, info: dict[str, Any]) -> None:
            if losses is not None:
                losses.note(
                    info.get('publication_sequence_number'), subscription.get_publisher_count()
                )
            if not self.active:
                return
            try:
                callback(message, *((self._arrival_of(info),) if timed else ()))
            except InputError as error:
                self.complain(topic, f'{topic}: message ignored: {error}')

        subscription = self.create_subscription(message_type, topic, guarded, qos)
        return subscription

    def _arrival_of(self, info: dict[str, Any]) -> int:
        """Time (ns) of the node's clock at which a message was received."""
        now = int(self.get_clock().now().nanoseconds)
        received = info.get('received_timestamp') or 0
        if self.get_clock().ros_time_is_active or received <= 0:
            return now
        return min(now, int(received))

    def serve(
        self,
        service_type: Any,
        name: str,
        callback: Callable[[Any, Any], Any],
        *,
        group: CallbackGroup | None = None,
    ) -> Service:
        """Offer a service (with ``success`` and ``message``), its events open to the recorder."""

        def guarded(request: Any, response: Any) -> Any:
            if not self.active:
                response.message = f'{self.get_name()} {NOT_ACTIVE}'
                return response
            try:
                return callback(request, response)
            except InputError as error:
                refused = service_type.Response()
                refused.message = str(error)
                self.complain(name, f'{name}: request refused: {error}')
                return refused

        service = self.create_service(service_type, name, guarded, callback_group=group)
        service.configure_introspection(
            self.get_clock(), SERVICE_EVENT_QOS, ServiceIntrospectionState.CONTENTS
        )
        return service

    def every(
        self,
        period: float,
        callback: Callable[[], None],
        *,
        group: CallbackGroup | None = None,
    ) -> Timer:
        """Call back every ``period`` seconds while the node is active."""

        def guarded() -> None:
            if self.active:
                callback()

        return self.create_timer(period, guarded, callback_group=group)

    def complain(self, source: str, text: str) -> None:
        """Log an error, at most once a second for each source."""
        now = time.monotonic()
        if now - self._complained.get(source, -_COMPLAINT_PERIOD) >= _COMPLAINT_PERIOD:
            self._complained[source] = now
            self.get_logger().error(text)

    def shut_down(self) -> None:
        """Stop working and release everything, from whatever state; for the end of a process."""
        if self._state_machine.current_state[1] in ('unconfigured', 'inactive', 'active'):
            self.trigger_shutdown()

    # Transitions

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure and warm up; on an error log it, release everything, stay unconfigured."""
        self.get_logger().info('configuring')
        if not self._attempt('configure', self.configure) or not self._attempt(
            'warm up', self.warm_up
        ):
            self._release_all()
            return TransitionCallbackReturn.FAILURE
        self.get_logger().info('configured')
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Enable publishers and start working."""
        super().on_activate(state)
        self.active = True
        if self._attempt('activate', self.activate):
            self.get_logger().info('active')
            return TransitionCallbackReturn.SUCCESS
        self.active = False
        super().on_deactivate(state)
        return TransitionCallbackReturn.FAILURE

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop working and silence publishers."""
        self._stop(state)
        self.get_logger().info('deactivated')
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of everything that configuring made."""
        self._release_all()
        self.get_logger().info('cleaned up')
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop working where needed and let go of everything."""
        if self.active:
            self._stop(state)
        self._release_all()
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go back to unconfigured after a transition that raised."""
        return self.on_shutdown(state)

    def _stop(self, state: LifecycleState) -> None:
        self.active = False
        self._attempt('deactivate', self.deactivate)
        super().on_deactivate(state)

    def _attempt(self, verb: str, step: Callable[[], None]) -> bool:
        try:
            step()
        except InputError as error:
            self.get_logger().error(f'cannot {verb}: {error}')
        except Exception:  # noqa: BLE001 - whatever happens, the node lives and says what
            self.get_logger().error(f'cannot {verb}:\n{traceback.format_exc()}')
        else:
            return True
        return False

    def _autostart(self) -> None:
        if self._start_timer is not None:
            self.destroy_timer(self._start_timer)
            self._start_timer = None
        if (
            self._state_machine.current_state[1] == 'unconfigured'
            and self.trigger_configure() == TransitionCallbackReturn.SUCCESS
        ):
            self.trigger_activate()

    def _release_all(self) -> None:
        self._attempt('release', self.release)
        for entity in self._entities():
            if entity in self._permanent:
                continue
            if isinstance(entity, LifecyclePublisher):
                self.destroy_lifecycle_publisher(entity)
            elif isinstance(entity, Timer):
                self.destroy_timer(entity)
            elif isinstance(entity, Subscription):
                self.destroy_subscription(entity)
            elif isinstance(entity, Service):
                self.destroy_service(entity)
            else:
                self.destroy_client(entity) or self.destroy_publisher(entity)

    def _entities(self) -> list[Any]:
        kinds = (self.publishers, self.subscriptions, self.services, self.clients, self.timers)
        return [entity for kind in kinds for entity in kind]

    def _answer_invalid_transitions(self) -> None:
        # rclpy lets an impossible transition raise out of the service callback, unanswered.
        service = self._service_change_state
        change_state = service.callback

        def guarded(request: Any, response: Any) -> Any:
            try:
                return change_state(request, response)
            except rclpy_implementation.RCLError as error:
                self.get_logger().error(f'transition refused: {error}')
                response.success = False
                return response

        service.callback = guarded
