"""Bounds on clearance: against coal, dense sampling and scipy; never looser than the bodies."""

from __future__ import annotations

from itertools import pairwise

import coal
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.config_files import find_config
from ft_manip_ros.core.joint import Axis, Joint
from ft_manip_ros.core.planning.approach import approaches
from ft_manip_ros.core.planning.bounding import bounding_bodies, bounding_capsule, bounding_hull
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.link_capsules import capsule_model
from ft_manip_ros.core.planning.move_scan import ASK, BLOCKED, FREE, judged
from ft_manip_ros.core.planning.obstacles import Obstacle
from ft_manip_ros.core.planning.pair_distance import box_distance, segment_distance
from ft_manip_ros.core.planning.urdf_bodies import urdf_model
from support.chains import REAL_ARMS
from support.plain_collision import PlainChecker


def to_segment(points, ends):
    """Distances of points (K, 3) from a segment (2, 3)."""
    way = ends[1] - ends[0]
    along = np.clip((points - ends[0]) @ way / max(way @ way, 1e-300), 0.0, 1.0)
    return np.linalg.norm(points - ends[0] - along[:, None] * way, axis=1)


def on_cylinder(rng, radius, length):
    t = rng.uniform(0.0, 2.0 * np.pi, 500)
    z = rng.choice([-0.5, 0.5], 500) * length
    return np.column_stack([radius * np.cos(t), radius * np.sin(t), z])


def test_shapes_lie_within_their_capsules():
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(500, 3))
    ball *= 0.3 / np.linalg.norm(ball, axis=1)[:, None]
    corners = np.array(np.meshgrid([-0.1, 0.1], [-0.2, 0.2], [-0.5, 0.5])).reshape(3, -1).T
    rod = ball.copy()
    rod[:, 2] += np.sign(rod[:, 2]) * 0.4
    cloud = rng.normal(size=(60, 3)) * [0.05, 0.1, 0.4]
    vertices = coal.StdVec_Vec3s()
    vertices.extend(list(cloud))
    mesh = coal.Convex.convexHull(vertices, False, 'Qt')
    for shape, points, exact in (
        (coal.Sphere(0.3), ball, True),
        (coal.Capsule(0.3, 0.8), rod, True),
        (coal.Cylinder(0.2, 0.7), on_cylinder(rng, 0.2, 0.7), False),
        (coal.Box(0.2, 0.4, 1.0), corners, False),
        (coal.Ellipsoid(0.1, 0.2, 0.3), ball / 0.3 * [0.1, 0.2, 0.3], False),
        (mesh, cloud, False),
    ):
        capsule = bounding_capsule(shape)
        off = to_segment(points, capsule.points)
        assert off.max() <= capsule.radius + 1e-8
        assert capsule.exact is exact
        if exact:
            assert off.min() >= capsule.radius - 1e-8
    # Not wider than need be: the cloud in its capsule, the box in the ball through its corners.
    assert bounding_capsule(mesh).radius < 0.35
    assert bounding_capsule(coal.Box(0.2, 0.4, 1.0)).radius < 0.25
    assert bounding_hull(coal.Box(0.2, 0.4, 1.0)).exact
    np.testing.assert_allclose(
        sorted(map(tuple, bounding_hull(coal.Box(0.2, 0.4, 1.0)).points)),
        sorted(map(tuple, corners)),
    )


def least(distance):
    """Least value of a convex function over the unit square, by scipy."""
    starts = [(0.5, 0.5), (0.0, 0.0), (1.0, 1.0), (0.0, 1.0), (1.0, 0.0)]
    found = [minimize(distance, x, bounds=[(0, 1)] * 2, tol=1e-14).fun for x in starts]
    return np.sqrt(min(found))


@pytest.mark.parametrize('case', range(40))
def test_distance_of_segments_by_minimisation(case):
    rng = np.random.default_rng(case)
    ends = rng.normal(size=(2, 2, 3))
    if case % 4 == 1:
        ends[1] = ends[0] + rng.normal(size=3)  # parallel
    if case % 4 == 2:
        ends[case % 8 // 4, 1] = ends[case % 8 // 4, 0]  # a point
    if case % 8 == 3:
        ends[:, 1] = ends[:, 0]
    if case % 8 == 7:
        ends[1, 0] = ends[0].mean(axis=0)  # they meet

    def squared(x):
        p, q = (e[0] + t * (e[1] - e[0]) for e, t in zip(ends, x, strict=True))
        return float((p - q) @ (p - q))

    assert segment_distance(ends, 0, 1) == pytest.approx(least(squared), abs=2e-6)


@pytest.mark.parametrize('case', range(20))
def test_distance_to_a_box_by_dense_sampling(case):
    rng = np.random.default_rng(case)
    rotation = Rotation.random(random_state=case).as_matrix()
    centre, half = rng.normal(size=3), rng.uniform(0.05, 1.0, 3)
    ends = centre + rng.normal(size=(2, 3)) * 1.5
    points = ends[0] + np.linspace(0.0, 1.0, 20001)[:, None] * (ends[1] - ends[0])
    local = np.abs((points - centre) @ rotation) - half
    dense = np.linalg.norm(np.maximum(local, 0.0), axis=1).min()
    step = np.linalg.norm(ends[1] - ends[0]) / 20000
    found = box_distance(ends, rotation, centre, half)
    assert dense - step <= found <= dense + 1e-9


def sliding_arm():
    """Five joints, one of which slides, and one that another axis follows."""
    rng = np.random.default_rng(4)
    joints = tuple(
        Joint(f'j{i}', -1.5, 1.5) if i != 2 else Joint('j2', -0.3, 0.2, prismatic=True)
        for i in range(5)
    )
    axes = [Axis(joint.name, i, prismatic=joint.prismatic) for i, joint in enumerate(joints)]
    axes.insert(4, Axis('follower', 1, -0.7))
    rotations = Rotation.random(7, random_state=3).as_matrix()
    translations = rng.uniform(-1.0, 1.0, (7, 3)) * 0.4
    return SerialChain('sliding', joints, rotations, translations, driven=tuple(axes))


AROUND = (
    Obstacle('table', 'box', (1.2, 0.8, 0.05), np.array([0.6, 0.2, -0.1]), np.eye(3)),
    Obstacle('post', 'cylinder', (0.05, 0.6), np.array([-0.4, 0.3, 0.3]), np.eye(3)),
    Obstacle('ball', 'sphere', (0.15,), np.array([0.2, -0.5, 0.5]), np.eye(3)),
)


def models():
    table_3 = load_arm('paredis_table_3')
    yield 'table 3', capsule_model(table_3, 0.04)
    yield 'table 3 among bodies', capsule_model(table_3, 0.03, AROUND)
    yield 'sliding', capsule_model(sliding_arm(), 0.03, AROUND, 0.005)
    for name in ('panda', 'tiago'):
        urdf, base, tip, _ = REAL_ARMS[name]
        arm = load_arm(urdf, base=base, tip=tip)
        text = find_config('arms', urdf).read_text()
        yield name, urdf_model(arm, text, base, AROUND if name == 'panda' else ())


MODELS = dict(models())


@pytest.mark.parametrize('name', MODELS)
def test_answers_are_those_of_coal_alone(name):
    bodies = MODELS[name]
    judge = CollisionChecker(bodies)
    plain = PlainChecker(bodies, approaches(bounding_bodies(bodies), bodies.chain))
    rng = np.random.default_rng(2)
    chain = bodies.chain
    # Also from a little outside the limits, as a frozen joint may stand.
    room = 0.1 * (chain.upper - chain.lower)
    qs = rng.uniform(chain.lower - room, chain.upper + room, (300, chain.n))
    known = [plain.touches(q) for q in qs]
    assert [judge.touches(q) for q in qs] == known
    assert [judge.touching(q) is not None for q in qs[:40]] == known[:40]
    free = qs[~np.array(known)][:24]
    moves = [(a, a + 0.3 * (b - a)) for a, b in pairwise(free)]
    found = [judge.move_touches(a, b) for a, b in moves]
    assert found == [plain.move_touches(a, b) for a, b in moves]
    # In searches the same is asked in compiled code, of the joints that move.
    some = np.arange(1, chain.n)
    settled = 0
    for a, b in moves:
        there = np.where(np.arange(chain.n) == 0, a, b)
        said = judged(judge.scan(a, some), a[some], there[some])
        if said != ASK:
            settled += 1
            assert said == (BLOCKED if judge.move_touches(a, there) else FREE)
    # Coal has to be asked about every move of the TIAGo.
    assert settled > len(moves) / 2 or name == 'tiago'
    for (a, b), touching in zip(moves, found, strict=True):
        if not touching:
            assert not any(plain.touches(a + t * (b - a)) for t in np.linspace(0.0, 1.0, 60))


@pytest.mark.parametrize('name', MODELS)
def test_no_pair_approaches_faster_than_is_said(name):
    bodies = MODELS[name]
    chain = bodies.chain
    rates = approaches(bounding_bodies(bodies), chain)
    plain = PlainChecker(bodies, rates)
    rng = np.random.default_rng(3)
    share = 0.0
    for _ in range(150):
        a = rng.uniform(chain.lower, chain.upper)
        step = rng.normal(size=chain.n) * 0.02 * (rng.random(chain.n) < 0.4)
        b = np.clip(a + step, chain.lower, chain.upper)
        before, after = plain.distances(a), plain.distances(b)
        apart = (before > 0.0) & (after > 0.0)
        change, allowed = np.abs(after - before)[apart], (rates @ np.abs(b - a))[apart]
        assert np.all(change <= allowed + 1e-5)
        share = max(share, float(np.max(change / np.maximum(allowed, 1e-3), initial=0.0)))
    # Nor are the bounds idle.
    assert share > 0.5
