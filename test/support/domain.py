"""A ROS_DOMAIN_ID that no other test process on this machine has."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# Above these, the ports of a domain fall into Linux's range for outgoing connections. 0 is what
# everybody has who did not choose.
_DOMAINS = range(1, 102)


@contextmanager
def free_domain() -> Iterator[int]:
    """Hold a domain for as long as the block lasts, and make it this process's.

    The claim is a lock on a file: the kernel drops it with the process, however that ends.
    """
    folder = Path(tempfile.gettempdir()) / f'ft_manip_ros_domains_{os.getuid()}'
    folder.mkdir(exist_ok=True)
    start = os.getpid() % len(_DOMAINS)
    for domain in (*_DOMAINS[start:], *_DOMAINS[:start]):
        with open(folder / str(domain), 'w') as claim:
            try:
                fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            with _environment(
                ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST'
            ):
                yield domain
            return
    raise RuntimeError(f'all ROS domains are taken: see {folder}')


@contextmanager
def _environment(**changes: str) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in changes}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
