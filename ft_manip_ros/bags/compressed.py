"""rosbag2's own compression: whole storage files, or each message, packed with zstd.

It is not the compression inside MCAP files, which `mcap_records` undoes chunk by chunk.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import zstandard

from ft_manip_ros.core.errors import InputError

SUFFIX = '.zstd'
# What a zstd frame begins with; serialized messages begin with a zero.
_MAGIC = b'\x28\xb5\x2f\xfd'
_LARGEST_MESSAGE = 1 << 28
_BLOCK = 1 << 20


class UnpackedFile:
    """A storage file unpacked into a folder that goes when this object does.

    Attributes
    ----------
    path
        The unpacked file.
    problem
        What kept the rest from being unpacked; empty when all was.

    Raises
    ------
    InputError
        If the file cannot be read, nothing in it unpacks, or there is no room to unpack it.
    """

    def __init__(self, path: Path) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix='ft_manip_bag_')
        self.path = Path(self._folder.name, path.name.removesuffix(SUFFIX))
        self.problem = ''
        try:
            with path.open('rb') as packed, self.path.open('wb') as unpacked:
                reader = zstandard.ZstdDecompressor().stream_reader(
                    packed, read_across_frames=True
                )
                try:
                    while block := reader.read(_BLOCK):
                        unpacked.write(block)
                except zstandard.ZstdError as error:
                    if not unpacked.tell():
                        raise InputError(
                            f'bag file {path}', f'does not unpack to an MCAP or db3 file ({error})'
                        ) from None
                    self.problem = f'does not unpack to its end ({error})'
        except OSError as error:
            raise InputError(f'bag file {path}', f'cannot be unpacked: {error.strerror}') from None


def unpack_message(data: bytes) -> bytes:
    """Bytes of a message, unpacked where they are packed.

    Damage is left as it is: whoever decodes the message finds that it is none.
    """
    if data[:4] != _MAGIC:
        return data
    try:
        if zstandard.frame_content_size(data) > _LARGEST_MESSAGE:
            return data
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=_LARGEST_MESSAGE)
    except zstandard.ZstdError:
        return data
