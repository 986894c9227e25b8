"""Node processes under test: started as a user starts them, and none left behind."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import psutil

_STOP_TIME = 10.0  # s, more than a node is allowed, for machines under load
_PR_SET_PDEATHSIG = 1


class NodeProcess:
    """One running command with everything it printed.

    Parameters
    ----------
    command
        Program and arguments.
    env
        Environment variables beside (or over) those of the tests.
    """

    def __init__(self, command: Sequence[str], env: Mapping[str, str] | None = None) -> None:
        self.command = list(command)
        self._lines: list[str] = []
        self._news = threading.Condition()
        self._process = subprocess.Popen(
            self.command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors='replace',
            env={**os.environ, 'PYTHONUNBUFFERED': '1', **(env or {})},
            start_new_session=True,
            preexec_fn=_end_with_parent,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Process id, which is also the id of its process group."""
        return self._process.pid

    @property
    def output(self) -> str:
        """Everything printed so far, standard output and error together."""
        with self._news:
            return ''.join(self._lines)

    @property
    def running(self) -> bool:
        """Whether the process has not ended yet."""
        return self._process.poll() is None

    def wait_for(self, text: str, timeout: float = 60.0) -> str:
        """Wait until `text` was printed and return the line with it."""
        deadline = time.monotonic() + timeout
        with self._news:
            while True:
                for line in self._lines:
                    if text in line:
                        return line
                left = deadline - time.monotonic()
                if left <= 0.0 or not self._reader.is_alive():
                    raise AssertionError(
                        f'{self} did not print {text!r}; it printed:\n{self.output}'
                    )
                self._news.wait(min(left, 0.2))

    def wait(self, timeout: float) -> int:
        """Wait for the end and return the exit code."""
        try:
            code = self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise AssertionError(
                f'{self} still runs after {timeout} s; it printed:\n{self.output}'
            ) from None
        self._reader.join(1.0)
        return code

    def stop(self, number: int = signal.SIGINT, timeout: float = _STOP_TIME) -> int:
        """Send a signal to the process and return its exit code."""
        if self.running:
            os.kill(self.pid, number)
        return self.wait(timeout)

    def members(self) -> list[psutil.Process]:
        """Every living process of the group."""
        found = []
        for process in psutil.process_iter():
            try:
                if os.getpgid(process.pid) == self.pid and process.status() != 'zombie':
                    found.append(process)
            except (ProcessLookupError, psutil.NoSuchProcess):
                continue
        return found

    def clean_up(self) -> list[str]:
        """End the group, gently first; return what had to be killed."""
        if self.running:
            os.kill(self.pid, signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_STOP_TIME)
        left = self.members()
        _, left = psutil.wait_procs(left, timeout=1.0) if left else ([], [])
        names = [f'{self}: process {process.pid} ({process.name()})' for process in left]
        if left:
            os.killpg(self.pid, signal.SIGKILL)
            # The kernel takes a moment.
            psutil.wait_procs(left, timeout=_STOP_TIME)
        self._process.wait()
        self._reader.join(1.0)
        return names

    def __str__(self) -> str:
        return ' '.join([Path(self.command[0]).name, *self.command[1:]])

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._news:
                self._lines.append(line)
                self._news.notify_all()
        with self._news:
            self._news.notify_all()


def _end_with_parent() -> None:
    """Let the kernel end the child where the tests are killed before they can clean up."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
