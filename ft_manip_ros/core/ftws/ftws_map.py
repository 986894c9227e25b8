"""A finished map: look-ups, rigorous area and volume, files."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.map_frame import GRIDS, MapFrame
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.whole_file import whole_file

FORMAT = 'ft_manip_ros/ftws-map/2'
_VERDICTS = {1: Verdict.MEMBER, 0: Verdict.UNDECIDED, -1: Verdict.NON_MEMBER}


@dataclass(frozen=True, eq=False)
class FtwsMap:
    """Proved cells of the FTWS: 1 member, -1 non-member, 0 not proved.

    Attributes
    ----------
    arm, order, tolerance
        What was asked.
    fingerprint
        `arm_fingerprint` of the arm.
    frame
        Where the map lies.
    low, high : ndarray, shape (d,)
        Range of the map coordinates (m).
    grid : ndarray of int8, shape (2^depth,) * d
        One byte a cell; each verdict holds for all of the (closed) cell.
    complete
        False if the refinement was interrupted.
    """

    arm: str
    fingerprint: str
    order: int
    tolerance: float
    frame: MapFrame
    low: Array
    high: Array
    grid: NDArray[np.int8]
    complete: bool = True

    def __post_init__(self) -> None:
        cells = self.grid.shape[0]
        object.__setattr__(self, '_low', [float(value) for value in self.low])
        object.__setattr__(self, '_scale', [cells / float(w) for w in self.high - self.low])
        object.__setattr__(self, '_bytes', self.grid.tobytes())

    _low: list[float] = None  # type: ignore[assignment]
    _scale: list[float] = None  # type: ignore[assignment]
    _bytes: bytes = b''

    def lookup(self, point: Sequence[float]) -> Verdict:
        """Verdict on a point (m); UNDECIDED where the map does not speak of it."""
        coordinates = self.frame.coordinates(point)
        if coordinates is None:
            return Verdict.UNDECIDED
        cells = self.grid.shape[0]
        place = 0
        for value, low, scale in zip(coordinates, self._low, self._scale, strict=True):
            at = (value - low) * scale
            if not 0.0 <= at < cells:
                return Verdict.UNDECIDED
            place = place * cells + int(at)
        byte = self._bytes[place]
        return _VERDICTS[byte if byte < 128 else byte - 256]

    def measure(self) -> tuple[float, float]:
        """Proved lower and upper bound of the FTWS within the map: area (m^2) or volume (m^3).

        For an ``'rz'`` map, the volume of the solid of revolution. The upper bound holds for
        the map's own range.
        """
        widths = (self.high - self.low) / self.grid.shape[0]
        weight: Array = np.full(self.grid.shape, float(np.prod(widths)))
        if self.frame.kind == 'rz':
            edges = self.low[0] + widths[0] * np.arange(self.grid.shape[0] + 1)
            rings = math.pi * (edges[1:] ** 2 - edges[:-1] ** 2) * widths[1]
            weight = np.repeat(rings[:, None], self.grid.shape[1], axis=1)
        return float(weight[self.grid == 1].sum()), float(weight[self.grid >= 0].sum())

    def cells(self) -> tuple[Array, NDArray[np.int8]]:
        """Centres (N, 3) (m) of all finest cells and their verdicts (N,)."""
        widths = (self.high - self.low) / self.grid.shape[0]
        index = np.indices(self.grid.shape).reshape(self.grid.ndim, -1).T
        return self.frame.points(self.low + (index + 0.5) * widths), self.grid.ravel()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write ``.npz`` (read back by `load_map`) or ``.csv`` (cell centres and verdicts).

        Raises
        ------
        InputError
            For another suffix, or a file that cannot be written.
        """
        target = Path(path)
        if target.suffix not in ('.npz', '.csv'):
            raise InputError(str(path), 'has no known suffix; .npz and .csv are written')
        with whole_file(target) as partial:
            if target.suffix == '.csv':
                points, verdicts = self.cells()
                with partial.open('w', encoding='utf-8') as file:
                    file.write('x,y,z,verdict\n')
                    for (x, y, z), verdict in zip(points, verdicts, strict=True):
                        file.write(f'{x:.9g},{y:.9g},{z:.9g},{_VERDICTS[int(verdict)].value}\n')
            else:
                np.savez_compressed(
                    partial,
                    format=FORMAT,
                    arm=self.arm,
                    fingerprint=self.fingerprint,
                    order=self.order,
                    tolerance=self.tolerance,
                    kind=self.frame.kind,
                    origin=self.frame.origin,
                    directions=self.frame.directions,
                    low=self.low,
                    high=self.high,
                    grid=self.grid,
                    complete=self.complete,
                )


def arm_fingerprint(chain: SerialChain) -> str:
    """Digest of all that verdicts depend on: joints, limits and placements of an arm."""
    digest = hashlib.sha256()
    for joint in chain.joints:
        digest.update(
            f'{joint.name} {joint.prismatic} {joint.lower!r} {joint.upper!r} '
            f'{joint.operating!r}\n'.encode()
        )
    for placements in (chain.rotations, chain.translations):
        digest.update(np.ascontiguousarray(placements, dtype='<f8').tobytes())
    return digest.hexdigest()


def load_map(path: str | os.PathLike[str], chain: SerialChain | None = None) -> FtwsMap:
    """Read a map written by `FtwsMap.save` as ``.npz``.

    Parameters
    ----------
    chain
        The arm that the map has to be of; None: any.

    Raises
    ------
    InputError
        For a file that is missing or no map, or a map of another arm.
    """
    try:
        with np.load(Path(path), allow_pickle=False) as data:
            if str(data['format']) != FORMAT or str(data['kind']) not in GRIDS:
                raise InputError(f'{path}: format', f'is not {FORMAT!r}')
            frame = MapFrame(str(data['kind']), data['origin'], data['directions'])
            found = FtwsMap(
                str(data['arm']),
                str(data['fingerprint']),
                int(data['order']),
                float(data['tolerance']),
                frame,
                data['low'],
                data['high'],
                np.ascontiguousarray(data['grid'], dtype=np.int8),
                bool(data['complete']),
            )
    except OSError as error:
        raise InputError(str(path), f'cannot be read: {error}') from None
    except InputError:
        raise
    except (ValueError, KeyError, EOFError, BadZipFile) as error:
        raise InputError(str(path), f'is not a map: {error}') from None
    if chain is not None and found.fingerprint != arm_fingerprint(chain):
        raise InputError(
            str(path), f'is a map of {found.arm!r} that differs from {chain.name!r} as it is now'
        )
    return found
