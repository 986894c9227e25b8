"""Forward kinematics, Jacobian and isotropy of a `SerialChain`, checked at the door."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.kernels import fk_batch, jacobian_batch


def fk(chain: SerialChain, q: Sequence[float] | Array) -> tuple[Array, Array]:
    """Tool rotation and position at posture ``q``.

    Parameters
    ----------
    q : shape (n,) or (N, n)
        Joint positions, rad or m.

    Returns
    -------
    rotation : shape (3, 3) or (N, 3, 3)
    position : shape (3,) or (N, 3)
        m, in the base frame.

    Raises
    ------
    InputError
        For a wrong length, NaN or infinity.
    """
    qs, single = _postures(chain, q)
    rotations = np.empty((len(qs), 3, 3))
    positions = np.empty((len(qs), 3))
    fk_batch(chain.arrays, qs, rotations, positions)
    return (rotations[0], positions[0]) if single else (rotations, positions)


def jacobian(chain: SerialChain, q: Sequence[float] | Array) -> Array:
    """Geometric Jacobian at the tool in the base frame: linear rows above angular rows.

    Parameters
    ----------
    q : shape (n,) or (N, n)

    Returns
    -------
    ndarray, shape (6, n) or (N, 6, n)
    """
    qs, single = _postures(chain, q)
    rotations = np.empty((len(qs), 3, 3))
    positions = np.empty((len(qs), 3))
    jacobians = np.empty((len(qs), 6, chain.n))
    jacobian_batch(chain.arrays, qs, rotations, positions, jacobians)
    return jacobians[0] if single else jacobians


def isotropy(matrix: Array) -> float:
    """Measure of isotropy of a Jacobian, equation 9 with its m-th root restored.

    ``det(J J^T)^(1/m) / (trace(J J^T) / m)``: 1 for an isotropic Jacobian, 0 for a singular one.

    Parameters
    ----------
    matrix : shape (m, n)
        The rows of the Jacobian that the task uses.
    """
    m = matrix.shape[0]
    gram = matrix @ matrix.T
    trace = float(np.trace(gram))
    if trace <= 0.0:
        return 0.0
    return float(max(np.linalg.det(gram), 0.0) ** (1.0 / m) / (trace / m))


def _postures(chain: SerialChain, q: Sequence[float] | Array) -> tuple[Array, bool]:
    qs = np.ascontiguousarray(q, dtype=float)
    single = qs.ndim == 1
    if single:
        qs = qs[None, :]
    if qs.ndim != 2 or qs.shape[1] != chain.n:
        raise InputError('q', f'has shape {np.shape(q)}; {chain.name!r} has {chain.n} joints')
    if not np.isfinite(qs).all():
        raise InputError('q', 'contains NaN or infinity')
    return qs, single
