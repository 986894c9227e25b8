"""Compiled bound of the task map's third derivative over a box of postures.

A derivative of the tool position is a nest of cross products (see `local_model`), so its norm is
at most the tool's distance to the axis of the last joint that takes part, and the sum over all
joint triples collapses to differences of powers of partial sums. A derivative of order m of the
error quaternion has norm ``2^-m``.
"""

from __future__ import annotations

import math

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel


@kernel
def third_order_bound(chain: ChainArrays, distance: Array, length: float, v: Array) -> float:
    """Bound of the third derivative along any direction within ``|dq_i| <= v_i``, over that box.

    Parameters
    ----------
    distance : shape (n,)
        Tool to axis at the box's centre (m); what the later joints can add is accounted for.
    length : float
        Metres per radian of the orientation rows, 0 without them.
    v : shape (n,)
        Half-widths of the box, >= 0.

    Returns
    -------
    float
        Bound of ``|D3 F[d, d, d]|`` for all d in the box, at every point of the box.
    """
    prismatic = chain.prismatic
    n = v.shape[0]
    total = 0.0
    for k in range(n):
        if not prismatic[k]:
            total += v[k]
    after = total
    moved = 0.0
    bound = 0.0
    for k in range(n - 1, -1, -1):
        if prismatic[k]:
            bound += 3.0 * v[k] * after * after
            moved += v[k]
        else:
            before = after - v[k]
            reach = distance[k] + moved
            bound += reach * v[k] * (after * after + after * before + before * before)
            moved += v[k] * reach
            after = before
    if length > 0.0:
        turning = 0.25 * length * total * total * total
        bound = math.sqrt(bound * bound + turning * turning)
    return bound
