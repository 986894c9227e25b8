"""How a bag is laid out on disk."""

from __future__ import annotations

from dataclasses import dataclass

from ft_manip_ros.bags.mcap_file import COMPRESSIONS
from ft_manip_ros.core.errors import InputError


@dataclass(frozen=True)
class WriterSettings:
    """How a bag is laid out on disk.

    Attributes
    ----------
    compression
        Of chunks: 'zstd', 'lz4' or 'none'.
    chunk_size
        Largest chunk before compression, bytes.
    flush_interval
        Longest time (s) that a message waits in memory, as long as `BagWriter.tick` is called.
    sync
        Also wait for the disk (fsync) at each flush: guards against loss of power too.
    split_size, split_duration
        Begin a new file beyond this size (bytes) or time span (s); 0 means never.
    """

    compression: str = 'zstd'
    chunk_size: int = 1 << 20
    flush_interval: float = 1.0
    sync: bool = False
    split_size: int = 0
    split_duration: float = 0.0

    def __post_init__(self) -> None:
        if self.compression not in COMPRESSIONS:
            raise InputError(
                'compression', f'is {self.compression!r}; valid are {", ".join(COMPRESSIONS)}'
            )
        for key, lowest in (('chunk_size', 1), ('split_size', 0), ('split_duration', 0.0)):
            if not getattr(self, key) >= lowest:
                raise InputError(key, f'is {getattr(self, key)}; must be at least {lowest}')
        if not self.flush_interval > 0.0:
            raise InputError('flush_interval', f'is {self.flush_interval}; must be > 0 s')
