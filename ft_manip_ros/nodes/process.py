"""One process, one node: initialise, spin, stop in bounded time after Ctrl-C or SIGTERM."""

from __future__ import annotations

import gc
import os
import signal
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import (
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    SingleThreadedExecutor,
)
from rclpy.signals import SignalHandlerOptions

from ft_manip_ros.nodes.managed_node import ManagedNode

_POLL = 0.2  # s, how often the spinning thread looks whether it should stop
GRACE = 1.5  # s, after which a process that is still stopping is ended


def run(
    factory: Callable[[], ManagedNode], args: Sequence[str] | None = None, *, grace: float = GRACE
) -> int:
    """Run a node until Ctrl-C, SIGTERM or a shutdown of its context.

    Parameters
    ----------
    grace
        Time (s) that the node may take to stop after a signal; then the process is ended.

    Returns
    -------
    int
        Exit code: 0, or 2 where the parameters given on the command line are unusable. Stopped
        by a signal it does not return: the process ends with 0.
    """
    # rclpy's own handlers would shut the context down first: nothing could be published or
    # answered while the node deactivates.
    rclpy.init(
        args=None if args is None else list(args), signal_handler_options=SignalHandlerOptions.NO
    )
    stop = threading.Event()
    _stop_on_signals(stop, grace)
    code = _serve(factory, stop)
    if stop.is_set():
        # The middleware tells others of the end when the last reference to the node is gone.
        gc.collect()
        # Taking compiled code and the interpreter apart is of no use to anybody, and on a busy
        # machine takes longer than a node is given to stop.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def _serve(factory: Callable[[], ManagedNode], stop: threading.Event) -> int:
    try:
        try:
            node = factory()
        except ParameterException as error:
            print(f'bad parameter: {error}', file=sys.stderr)
            return 2
        executor: Executor = (
            SingleThreadedExecutor()
            if node.threads == 1
            else MultiThreadedExecutor(num_threads=node.threads)
        )
        executor.add_node(node)
        try:
            _spin(node, executor, stop)
        finally:
            node.shut_down()
            executor.shutdown(timeout_sec=0.0)
            node.destroy_node()
        return 0
    finally:
        rclpy.try_shutdown()


def _spin(node: ManagedNode, executor: Executor, stop: threading.Event) -> None:
    while rclpy.ok() and not stop.is_set():
        try:
            executor.spin_once(timeout_sec=_POLL)
        except (KeyboardInterrupt, ExternalShutdownException):
            return
        except Exception:  # noqa: BLE001 - one callback's defect must not end the node
            node.get_logger().error(f'in a callback:\n{traceback.format_exc()}')


def _stop_on_signals(stop: threading.Event, grace: float) -> None:
    """Set ``stop`` on SIGINT or SIGTERM, and end the process if it does not end by itself.

    Python runs signal handlers in the main thread, between two of its instructions, so a long
    computation would delay them. The wake-up descriptor is written at once, and a thread reads it.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    numbers = (signal.SIGINT, signal.SIGTERM)

    def on_signal(*_: object) -> None:
        # A launch file passes on the Ctrl-C that the terminal has sent already. The second one
        # must not kill an interpreter that is on its way out.
        for number in numbers:
            signal.signal(number, signal.SIG_IGN)
        stop.set()

    for number in numbers:
        signal.signal(number, on_signal)
    signal.set_wakeup_fd(writer.detach(), warn_on_full_buffer=False)

    def watch() -> None:
        received = reader.recv(1)
        stop.set()
        # A process that ends in time takes this thread with it.
        time.sleep(grace)
        print('still busy: leaving without waiting any longer', file=sys.stderr, flush=True)
        os._exit(128 + received[0])

    threading.Thread(target=watch, name='signal watch', daemon=True).start()
