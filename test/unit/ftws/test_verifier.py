"""The verifier's own parts: derivatives, their bounds, coverings."""

import numpy as np
import pytest

from ft_manip_ros.core.ftws.verifier_arm import Arm
from ft_manip_ros.core.ftws.verifier_cover import uncovered
from ft_manip_ros.core.ftws.verifier_lost import lower_bounds


def random_arm(rng, n=5, slide=None, mode='position'):
    """An arm of random placements, as a certificate gives it."""
    joints = [
        {
            'name': f'joint_{i}',
            'prismatic': i == slide,
            'lower': -2.0,
            'upper': 2.0,
            'operating': [-2.0, 2.0],
            'fails': True,
        }
        for i in range(n)
    ]
    rotations = []
    for _ in range(n + 1):
        u = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        rotations.append((u * np.sign(np.linalg.det(u))).tolist())
    translations = rng.uniform(-0.5, 0.5, (n + 1, 3)).tolist()
    data = {'joints': joints, 'rotations': rotations, 'translations': translations}
    return Arm(data, mode, 1e-6, 1e-6)


def goal_near(arm, rng):
    """A goal some way from a random posture, so that the error quaternion keeps its sign."""
    q = rng.uniform(-1.0, 1.0, arm.n)
    quaternion = np.array([0.1, -0.2, 0.15, 0.95])
    goal = arm.goal([0.2, 0.1, -0.3], quaternion / np.linalg.norm(quaternion))
    goal[3:] = (goal[3:].reshape(3, 3) @ arm.frames(q[None])[2][0]).ravel()
    return q, goal


@pytest.mark.parametrize('mode', ['position', 'pose'])
@pytest.mark.parametrize('slide', [None, 0, 2])
def test_derivatives_are_those_of_the_residual(mode, slide):
    rng = np.random.default_rng(5)
    arm = random_arm(rng, slide=slide, mode=mode)
    q, goal = goal_near(arm, rng)
    at = arm.derivatives(q[None], goal)
    step = 1e-6
    for i in range(arm.n):
        ahead, behind = (
            arm.derivatives((q + sign * step * np.eye(arm.n)[i])[None], goal) for sign in (1, -1)
        )
        slope = (ahead.residual - behind.residual)[0] / (2.0 * step)
        assert at.jacobian[0, :, i] == pytest.approx(slope, abs=1e-8)
        bend = (ahead.jacobian - behind.jacobian)[0] / (2.0 * step)
        assert at.hessian[0, :, :, i] == pytest.approx(bend, abs=1e-8)


@pytest.mark.parametrize('mode', ['position', 'pose'])
def test_bounds_of_higher_derivatives_hold_everywhere_in_a_box(mode):
    rng = np.random.default_rng(6)
    for slide in (None, 1, 4):
        arm = random_arm(rng, slide=slide, mode=mode)
        q, goal = goal_near(arm, rng)
        v = rng.uniform(0.0, 0.15, arm.n)
        distance = arm.derivatives(q[None], goal).distance
        second, third = arm.second_bound(distance, v[None]), arm.third_bound(distance, v[None])
        for _ in range(200):
            place, d = q + rng.uniform(-1, 1, arm.n) * v, rng.choice([-1.0, 1.0], arm.n) * v
            at = [arm.derivatives((place + s * d)[None], goal).hessian[0] for s in (-1e-5, 1e-5)]
            assert np.linalg.norm(at[0] @ d @ d) <= second[0] * (1.0 + 1e-3)
            assert np.linalg.norm((at[1] - at[0]) @ d @ d) / 2e-5 <= third[0] * (1.0 + 1e-3)


@pytest.mark.parametrize('mode', ['position', 'pose'])
def test_lower_bounds_are_below_every_posture_of_the_box(mode):
    rng = np.random.default_rng(7)
    arm = random_arm(rng, mode=mode)
    q, goal = goal_near(arm, rng)
    useful = 0
    for _ in range(40):
        centre, half = q + rng.uniform(-1, 1, arm.n), rng.uniform(0.0, 0.3, arm.n)
        bound = lower_bounds(arm, centre[None], half[None], goal, None)[0][0]
        inside = centre + rng.uniform(-1, 1, (500, arm.n)) * half
        assert np.linalg.norm(arm.residuals(inside, goal), axis=1).min() >= bound
        useful += bound > 0.0
    assert useful > 5


def tiles(rng, k, count):
    """Ends (N, k) of boxes that together are the unit cube, cut up at random."""
    boxes = [(np.zeros(k), np.ones(k))]
    for _ in range(count - 1):
        low, high = boxes.pop(int(rng.integers(len(boxes))))
        side, share = int(rng.integers(k)), rng.uniform(0.2, 0.8)
        cut = low[side] + share * (high[side] - low[side])
        upper, lower = high.copy(), low.copy()
        upper[side] = lower[side] = cut
        boxes += [(low, upper), (lower, high)]
    return (np.array(ends) for ends in zip(*boxes, strict=True))


@pytest.mark.parametrize('k', [1, 2, 3])
def test_every_gap_in_a_covering_is_found(k):
    rng = np.random.default_rng(k)
    lows, highs = tiles(rng, k, 150)
    assert uncovered(np.zeros(k), np.ones(k), lows, highs) is None
    for missing in range(0, 150, 10):
        rest = np.arange(150) != missing
        gap = uncovered(np.zeros(k), np.ones(k), lows[rest], highs[rest])
        assert gap is not None
        assert (gap > lows[missing]).all() and (gap < highs[missing]).all()


def test_the_same_box_many_times_covers_no_more_than_once():
    lows, highs = np.zeros((40, 2)), np.full((40, 2), 0.5)
    gap = uncovered(np.zeros(2), np.ones(2), lows, highs)
    assert gap is not None and gap.max() > 0.5
    assert uncovered(np.zeros(2), np.full(2, 0.5), lows, highs) is None


def test_what_needs_no_cover_is_no_gap():
    gap = uncovered(
        np.zeros(2), np.ones(2), np.zeros((1, 2)), np.array([[1.0, 0.5]]), lambda a, _: a[1] >= 0.5
    )
    assert gap is None
