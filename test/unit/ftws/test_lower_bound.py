"""Lower bounds of the engine's refutation against postures sampled from the box."""

import numpy as np
import pytest

from ft_manip_ros.core.ftws.local_model import make_model
from ft_manip_ros.core.ftws.lower_bound import lower_bound
from ft_manip_ros.core.ftws.task_map import task_arrays
from ft_manip_ros.core.kinematics import fk
from support.chains import random_chain

NO_AIM = np.zeros(6)


def bound_over(chain, goal, spin, centre, half, aim=NO_AIM, target=np.inf):
    """Lower bound of the distance to a goal over a box, and the split's shares."""
    share = np.zeros(chain.n)
    bound, _ = lower_bound(
        chain.arrays, task_arrays(chain, 'position', None), np.array([*goal, 1.0, 0.0, 0.0, 0.0]),
        spin, centre, half, aim, make_model(chain.n, 3), np.zeros((2, 6)), share, target,
    )  # fmt: skip
    return bound, share


def sampled(chain, goal, spin, centre, half, rng, count=300):
    """Smallest distance that random postures of the box come to, and their corners.

    With a spin joint, the first one, the distance is that of radius and height about its axis.
    """
    start = chain.rotations[0]
    smallest = np.inf
    for i in range(count):
        d = rng.uniform(-1.0, 1.0, chain.n) if i % 2 else rng.choice([-1.0, 1.0], chain.n)
        tool = fk(chain, centre + half * d)[1]
        if spin < 0:
            smallest = min(smallest, float(np.linalg.norm(tool - goal)))
            continue
        a, b = (start.T @ (x - chain.translations[0]) for x in (tool, goal))
        smallest = min(
            smallest, float(np.hypot(np.hypot(a[0], a[1]) - np.hypot(b[0], b[1]), a[2] - b[2]))
        )
    return smallest


def near_the_axis(chain, centre, rng):
    """A goal at the tool's height, but much farther from the first axis than the tool."""
    a = chain.rotations[0].T @ (fk(chain, centre)[1] - chain.translations[0])
    a[:2] *= 1.0 + rng.uniform(0.5, 4.0)
    return chain.translations[0] + chain.rotations[0] @ a


@pytest.mark.parametrize('spin', [-1, 0])
def test_bounds_are_below_every_posture_of_the_box(spin):
    tight = 0
    for seed in range(150):
        rng = np.random.default_rng(seed)
        chain = random_chain(rng, joints=5, sliding=0.0)
        centre = rng.uniform(-2.0, 2.0, chain.n)
        half = rng.uniform(0.0, 1.0, chain.n) ** 2
        half[rng.integers(0, chain.n)] = 0.0
        if spin == 0:
            half[0] = 0.0
        goal = rng.normal(size=3) if seed % 2 else near_the_axis(chain, centre, rng)
        aim = rng.normal(size=6)
        aim[2 if spin == 0 else 3 :] = 0.0
        aim /= np.linalg.norm(aim)
        bound, _ = bound_over(chain, goal, spin, centre, half, aim)
        nearest = sampled(chain, goal, spin, centre, half, rng)
        assert bound <= nearest
        tight += bound > 0.3 * nearest
    # Bounds that say nothing would pass as well.
    assert tight > 15


def test_a_box_that_is_good_enough_is_bounded_above_the_target():
    rng = np.random.default_rng(1)
    chain = random_chain(rng, joints=4, sliding=0.0)
    centre, half = rng.uniform(-1.0, 1.0, 4), np.full(4, 0.02)
    goal = fk(chain, centre)[1] + 0.5
    full, _ = bound_over(chain, goal, -1, centre, half)
    early, _ = bound_over(chain, goal, -1, centre, half, target=0.1)
    assert 0.1 < early <= full
