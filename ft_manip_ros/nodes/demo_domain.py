"""A ROS_DOMAIN_ID of the demo's own, so that no run ever meets another one or a robot."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# Beyond these the ports of a domain fall into Linux's range for outgoing connections.
_DOMAINS = range(1, 102)


@contextmanager
def own_domain(wanted: int | None) -> Iterator[int]:
    """Set the environment to a domain on this machine only, and hold it for the block.

    Parameters
    ----------
    wanted
        The domain to take; None: one that no other run of this package holds. The claim is a
        lock on a file, which the kernel drops with the process, however that ends.
    """
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    if wanted is not None:
        os.environ['ROS_DOMAIN_ID'] = str(wanted)
        yield wanted
        return
    folder = Path(tempfile.gettempdir()) / f'ft_manip_ros_domains_{os.getuid()}'
    folder.mkdir(exist_ok=True)
    start = os.getpid() % len(_DOMAINS)
    for domain in (*_DOMAINS[start:], *_DOMAINS[:start]):
        with open(folder / str(domain), 'w') as claim:
            try:
                fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            os.environ['ROS_DOMAIN_ID'] = str(domain)
            yield domain
            return
    raise RuntimeError(f'all ROS domains are taken: see {folder}')
