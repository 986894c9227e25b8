"""Maps of the FTWS: cells proved as wholes, refined only where nothing is proved yet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.engine import run_engine
from ft_manip_ros.core.ftws.ftws_map import FtwsMap, arm_fingerprint
from ft_manip_ros.core.ftws.map_frame import MapFrame
from ft_manip_ros.core.ftws.planar_verdict import judge_many
from ft_manip_ros.core.ftws.problem import Problem, prepare
from ft_manip_ros.core.ftws.query import distance_off_plane
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.task_map import reach

_FIRST_LEVEL = 3
_DEEPEST = {2: 13, 3: 9}
_CHUNK = 32


def build_map(
    chain: SerialChain,
    frame: MapFrame,
    *,
    low: Sequence[float] | None = None,
    high: Sequence[float] | None = None,
    depth: int = 7,
    order: int = 1,
    tolerance: float = 1e-6,
    threads: int = 1,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> FtwsMap:
    """Map the positional FTWS.

    Each cell is judged by one covering or refutation of the ball of goals around it, so its
    verdict holds for every point of it. Cells that are neither are cut, down to ``2^depth``
    cells along each coordinate; what is left then is UNDECIDED. Ctrl-C (or ``should_stop``)
    ends the refinement early; the map is right all the same, only coarser.

    Parameters
    ----------
    low, high
        Range of each map coordinate (m); None: all that the arm can reach.
    depth
        Finest level.
    progress
        Called with the cells judged and the cells to judge at the present level.

    Raises
    ------
    InputError
        For impossible ranges, depth or order.
    """
    dimension = frame.dimension
    size = reach(chain) + float(np.linalg.norm(chain.translations[0] - frame.origin))
    lower = np.full(dimension, -size) if low is None else np.array(low, dtype=float)
    upper = np.full(dimension, size) if high is None else np.array(high, dtype=float)
    if low is None and frame.kind == 'rz':
        lower[0] = 0.0
    if lower.shape != (dimension,) or upper.shape != (dimension,):
        raise InputError('bounds', f'need a low and a high for each of {dimension} coordinates')
    if not (np.isfinite(lower).all() and np.isfinite(upper).all() and (lower < upper).all()):
        raise InputError('bounds', f'{lower.tolist()} to {upper.tolist()} is no range (m)')
    if frame.kind == 'rz' and lower[0] < 0.0:
        raise InputError('bounds', f'start at radius {lower[0]:g}; radii are >= 0')
    if not 1 <= depth <= _DEEPEST[dimension]:
        raise InputError('depth', f'is {depth}; must be 1 to {_DEEPEST[dimension]}')
    problem = prepare(chain, 'position', order)
    grid = np.zeros((2**depth,) * dimension, dtype=np.int8)
    level = min(_FIRST_LEVEL, depth)
    cells = np.stack(
        np.meshgrid(*[np.arange(2**level)] * dimension, indexing='ij'), axis=-1
    ).reshape(-1, dimension)
    complete = False
    try:
        while True:
            verdicts = _judge(
                problem,
                frame,
                lower,
                upper,
                level,
                cells,
                tolerance,
                threads,
                progress,
                should_stop,
            )
            _paint(grid, cells, verdicts, depth - level)
            cells = cells[verdicts == 0]
            if level == depth or len(cells) == 0:
                complete = True
                break
            if should_stop is not None and should_stop():
                break
            children = np.stack(np.meshgrid(*[np.arange(2)] * dimension, indexing='ij'), axis=-1)
            cells = (2 * cells[:, None, :] + children.reshape(-1, dimension)[None]).reshape(
                -1, dimension
            )
            level += 1
    except KeyboardInterrupt:
        pass
    fingerprint = arm_fingerprint(chain)
    return FtwsMap(chain.name, fingerprint, order, tolerance, frame, lower, upper, grid, complete)


def _judge(
    problem: Problem,
    frame: MapFrame,
    lower: Array,
    upper: Array,
    level: int,
    cells: NDArray[np.int64],
    tolerance: float,
    threads: int,
    progress: Callable[[int, int], None] | None,
    should_stop: Callable[[], bool] | None,
) -> NDArray[np.int8]:
    """Verdicts (N,) of cells (N, d) of one level; those not reached any more are 0."""
    width = (upper - lower) / 2**level
    radius = 0.5 * float(np.linalg.norm(width)) * (1.0 + 1e-9)
    settings = FtwsSettings(
        tolerance=tolerance,
        radius=radius,
        intervals=False,
        restarts=6,
        smallest_gap=2e-3,
        smallest_step=1e-4,
        boxes=4000,
        pieces=2000,
    )
    effort = settings.effort(False, problem.task.length)
    goals = np.zeros((len(cells), 7))
    goals[:, :3] = frame.points(lower + (cells + 0.5) * width)
    goals[:, 3] = 1.0
    verdicts = np.zeros(len(cells), dtype=np.int8)

    def judge(start: int) -> int:
        part = slice(start, start + _CHUNK)
        if should_stop is not None and should_stop():
            return 0
        off = np.array([distance_off_plane(problem, goal) for goal in goals[part]])
        if problem.form is not None and problem.closed:
            found = judge_many(problem.form, goals[part], off, tolerance, radius)
        else:
            found = run_engine(problem, goals[part], effort).verdicts.astype(np.int8)
        # A planar arm: all of the ball is off its plane, or part of it.
        if problem.plane is not None:
            found = np.where(off > tolerance + radius, -1, np.where(off > 1e-9, 0, found))
        verdicts[part] = found
        return len(found)

    done = 0
    with ThreadPoolExecutor(max(threads, 1)) as pool:
        try:
            for count in pool.map(judge, range(0, len(cells), _CHUNK)):
                done += count
                if progress is not None:
                    progress(done, len(cells))
        except KeyboardInterrupt:
            pool.shutdown(wait=True, cancel_futures=True)
            raise
    return verdicts


def _paint(
    grid: NDArray[np.int8], cells: NDArray[np.int64], verdicts: NDArray[np.int8], up: int
) -> None:
    """Write cells of a coarser level into the finest grid."""
    side = 2**up
    for cell, verdict in zip(cells[verdicts != 0], verdicts[verdicts != 0], strict=True):
        grid[tuple(slice(int(c) * side, (int(c) + 1) * side) for c in cell)] = verdict
