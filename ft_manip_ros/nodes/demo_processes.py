"""The processes of the demo: started with their logs, ended with everything they started."""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

_PR_SET_PDEATHSIG = 1
# Nodes end within 2 s, by force after 1.5 s; what still lives then is killed.
_STOP_TIME = 1.8  # s


class Processes:
    """Node processes, each in a process group of its own; none survives this object's block.

    Parameters
    ----------
    logs
        Folder for what the processes print, one file each.
    """

    def __init__(self, logs: Path) -> None:
        self.logs = logs
        logs.mkdir(parents=True, exist_ok=True)
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, node: str, parameters: Mapping[str, Any]) -> None:
        """Start a node of this package with ROS parameters."""
        command = [sys.executable, '-m', f'ft_manip_ros.nodes.{node}', '--ros-args']
        for name, value in parameters.items():
            command += ['-p', f'{name}:={json.dumps(value)}']
        with open(self.logs / f'{node}.log', 'ab') as log:
            self._running[node] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_end_with_parent,
            )

    def dead(self) -> list[str]:
        """Return a line on each process that ended without being asked to."""
        return [
            f'{node} ended with exit code {process.returncode}; its last words: {self.tail(node)}'
            for node, process in self._running.items()
            if process.poll() is not None
        ]

    def tail(self, node: str) -> str:
        """Return the last line that a node printed."""
        lines = (self.logs / f'{node}.log').read_text(errors='replace').strip().splitlines()
        return lines[-1] if lines else '(nothing)'

    def stop(self, *nodes: str) -> None:
        """End the named processes, or all: Ctrl-C first, then by force, children included."""
        chosen = {node: self._running.pop(node) for node in nodes or tuple(self._running)}
        for process in chosen.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + _STOP_TIME
        for process in chosen.values():
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, deadline - time.monotonic()))
        for process in chosen.values():
            # Also where the process itself has ended: it may have left children in its group.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()

    def __enter__(self) -> Processes:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        # A second Ctrl-C must not leave the rest running.
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            self.stop()
        finally:
            signal.signal(signal.SIGINT, before)


def _end_with_parent() -> None:
    """Let the kernel end a node whose demo was killed before it could clean up."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
