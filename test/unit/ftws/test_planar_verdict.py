"""Planar arms without limits: verdicts of any order against coverings and numerical reach."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import least_squares

from ft_manip_ros.core.ftws.effort import MEMBER, NON_MEMBER
from ft_manip_ros.core.ftws.engine import run_engine
from ft_manip_ros.core.ftws.map_build import build_map
from ft_manip_ros.core.ftws.map_frame import map_frame
from ft_manip_ros.core.ftws.planar import planar_ftws
from ft_manip_ros.core.ftws.planar_verdict import judge_planar
from ft_manip_ros.core.ftws.problem import prepare
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.kinematics import fk
from unit.ftws.arms import dh_arm, planar

SETTINGS = FtwsSettings(intervals=False)


def facing_anywhere(rng, lengths):
    """Planar arm with axes up and down, at different heights, somewhere in space."""
    n = len(lengths)
    arm = dh_arm(rng.uniform(-0.2, 0.2, n), lengths, rng.choice([0.0, np.pi], n))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    rotations, translations = arm.rotations.copy(), arm.translations.copy()
    rotations[0], translations[0] = turn, rng.uniform(-1.0, 1.0, 3)
    return replace(arm, rotations=rotations, translations=translations)


def at_radius(arm, rng, radius):
    """A point of the arm's plane at a distance from its first axis."""
    angle = rng.uniform(-np.pi, np.pi)
    across = arm.rotations[0] @ [np.cos(angle), np.sin(angle), 0.0]
    axis = arm.rotations[0][:, 2]
    height = axis @ (fk(arm, np.zeros(arm.n))[1] - arm.translations[0])
    return arm.translations[0] + radius * across + height * axis


def row_of(point):
    return np.array([*point, 1.0, 0.0, 0.0, 0.0])


def closest(arm, point, frozen, rng, starts=12, turned=None, length=0.0, enough=1e-8):
    """Smallest residual (m) that SciPy finds with joints frozen, {joint: angle}."""
    free = [j for j in range(arm.n) if j not in frozen]

    def residual(x):
        q = np.zeros(arm.n)
        q[list(frozen)], q[free] = list(frozen.values()), x
        rotation, position = fk(arm, q)
        if turned is None:
            return position - point
        angle = np.arctan2(rotation[1, 0], rotation[0, 0]) - turned
        return np.array([*(position - point), 2.0 * length * np.sin(0.5 * angle)])

    best = np.inf
    for _ in range(starts):
        found = least_squares(residual, rng.uniform(-np.pi, np.pi, len(free)), ftol=1e-14)
        best = min(best, float(np.linalg.norm(found.fun)))
        if best <= enough:
            break
    return best


@pytest.mark.parametrize('order', [2, 3, 4])
def test_unit_links_reach_the_disc_of_radius_2(order):
    arm = planar(*[1.0] * (2 * order + 2))
    points = np.zeros((5, 3))
    points[:, 1] = [0.0, 0.8, 1.99, 2.0, 2.01]
    answers = query(arm, points, order=order, settings=SETTINGS)
    assert [a.verdict for a in answers] == [Verdict.MEMBER] * 4 + [Verdict.NON_MEMBER]
    assert [a.margin for a in answers[:3]] == pytest.approx([2.0, 1.2, 0.01], abs=1e-9)
    assert answers[4].residual == pytest.approx(0.01, abs=1e-9)
    assert len(answers[4].joints) == order


@pytest.mark.parametrize('order', [2, 3])
def test_one_link_less_leaves_the_circle_of_radius_1(order):
    arm = planar(*[1.0] * (2 * order + 1))
    points = np.zeros((5, 3))
    points[:, 0] = [0.0, 0.99, 1.0, 1.00001, 1.7]
    answers = query(arm, points, order=order, settings=SETTINGS)
    lost, on = Verdict.NON_MEMBER, Verdict.MEMBER
    assert [a.verdict for a in answers] == [lost, lost, on, lost, lost]


def test_order_1_agrees_with_the_covering():
    rng = np.random.default_rng(11)
    kinds = set()
    for n in (3, 4, 5, 6):
        for _ in range(3):
            arm = facing_anywhere(rng, rng.uniform(0.1, 1.0, n))
            problem = prepare(arm, 'position', 1)
            effort = SETTINGS.effort(False, problem.task.length)
            for radius in rng.uniform(0.0, 0.6 * n, 6):
                row = row_of(at_radius(arm, rng, radius))
                mine = judge_planar(problem.form, row, 0.0, 1e-6, 0.0, problem.ranges)
                covered = int(run_engine(problem, row[None], effort).verdicts[0])
                if covered != 0:
                    assert mine.code == covered, (arm.translations, row)
                    kinds.add(covered)
    assert kinds == {MEMBER, NON_MEMBER}


def test_order_2_agrees_with_the_covering_where_it_decides():
    rng = np.random.default_rng(12)
    kinds = []
    for _ in range(4):
        lengths = rng.uniform(0.6, 1.0, 6)
        arm = planar(*lengths)
        problem = prepare(arm, 'position', 2)
        effort = replace(SETTINGS, pieces=3000).effort(False, problem.task.length)
        for radius in (0.45 * lengths.sum(), 0.2 * lengths.sum()):
            row = row_of([radius, 0.0, 0.0])
            mine = judge_planar(problem.form, row, 0.0, 1e-6, 0.0, problem.ranges)
            covered = int(run_engine(problem, row[None], effort).verdicts[0])
            assert covered in (0, mine.code)
            kinds.append(covered)
    assert NON_MEMBER in kinds


@pytest.mark.parametrize(('order', 'n'), [(2, 5), (2, 6), (3, 6), (3, 8)])
def test_random_failures_find_no_member_lost_and_no_worse_witness(order, n):
    rng = np.random.default_rng(100 * order + n)
    kinds = set()
    for _ in range(3):
        arm = facing_anywhere(rng, rng.uniform(0.3, 1.0, n) * (rng.random(n) > 0.1))
        for radius in rng.uniform(0.0, 2.2, 2):
            point = at_radius(arm, rng, radius)
            answer = query(arm, point[None], order=order, settings=SETTINGS)[0]
            kinds.add(answer.verdict)
            combos = list(combinations(range(n), order))
            most = answer.residual + 1e-7
            for _ in range(6):
                joints = combos[rng.integers(len(combos))]
                frozen = dict(zip(joints, rng.uniform(-np.pi, np.pi, order), strict=True))
                assert closest(arm, point, frozen, rng, enough=most) <= most
            if answer.verdict is Verdict.NON_MEMBER:
                at = [arm.index(name) for name in answer.joints]
                frozen = dict(zip(at, answer.angles, strict=True))
                as_near = answer.residual + 1e-5
                found = closest(arm, point, frozen, rng, enough=as_near)
                # The claim is the exact distance: no posture is nearer, and one is as near.
                assert answer.residual - 1e-9 <= found <= as_near
    assert Verdict.NON_MEMBER in kinds


def test_members_of_order_3_are_reached_whatever_freezes():
    rng = np.random.default_rng(5)
    arm = facing_anywhere(rng, rng.uniform(0.9, 1.1, 8))
    point = at_radius(arm, rng, 0.9)
    answer = query(arm, point[None], order=3, settings=SETTINGS)[0]
    assert answer.verdict is Verdict.MEMBER
    for joints in combinations(range(8), 3):
        frozen = dict(zip(joints, rng.choice([0.0, np.pi, 1.3], 3), strict=True))
        assert closest(arm, point, frozen, rng) < 1e-7


def test_the_margin_is_where_the_ftws_ends():
    rng = np.random.default_rng(6)
    checked = 0
    for _ in range(40):
        order = int(rng.integers(2, 4))
        lengths = rng.uniform(0.5, 1.0, 2 * order + 3)
        for low, high in planar_ftws(lengths, order):
            if high - low < 1e-2:
                continue
            radius = rng.uniform(low, high)
            edge = min([high - radius] + ([radius - low] if low > 0.0 else []))
            point = np.array([[0.0, radius, 0.0]])
            answer = query(planar(*lengths), point, order=order, settings=SETTINGS)[0]
            assert answer.verdict is Verdict.MEMBER
            assert answer.margin == pytest.approx(edge, abs=1e-9)
            for share, verdict in ((0.99, Verdict.MEMBER), (1.01, Verdict.UNDECIDED)):
                ball = replace(SETTINGS, radius=share * edge)
                asked = query(planar(*lengths), point, order=order, settings=ball)[0]
                assert asked.verdict is verdict
            checked += 1
    assert checked > 20


def test_a_ball_is_lost_only_as_a_whole():
    arm, point = planar(*[1.0] * 6), np.array([[2.5, 0.0, 0.0]])
    for radius, verdict in ((0.49, Verdict.NON_MEMBER), (0.51, Verdict.UNDECIDED)):
        settings = replace(SETTINGS, radius=radius)
        assert query(arm, point, order=2, settings=settings)[0].verdict is verdict


def test_a_ball_about_a_point_off_the_plane_is_no_member():
    settings = replace(SETTINGS, radius=0.1)
    answer = query(planar(*[1.0] * 6), np.array([[0.5, 0, 0.05]]), order=2, settings=settings)[0]
    assert answer.verdict is Verdict.UNDECIDED


def test_operating_limits_leave_members_and_witnesses_within_them():
    whole = planar(*[1.0] * 6)
    joints = tuple(replace(j, operating_lower=-3.0, operating_upper=3.0) for j in whole.joints)
    arm = replace(whole, joints=joints)
    points = np.array([[1.5, 0.0, 0.0], [2.5, 0.0, 0.0]])
    member, lost = query(arm, points, order=2, settings=SETTINGS)
    assert member.verdict is Verdict.MEMBER and member.closed_form
    assert lost.verdict is Verdict.NON_MEMBER and np.abs(lost.angles).max() <= 3.0
    # Frozen joints that cannot stretch or turn away lose less: the covering is asked.
    narrow = tuple(replace(j, operating_lower=-0.2, operating_upper=0.2) for j in whole.joints)
    settings = replace(SETTINGS, pieces=200)
    answer = query(replace(whole, joints=narrow), points[1:], order=2, settings=settings)[0]
    assert not answer.closed_form


def test_arms_with_limits_are_covered():
    arm = planar(*[1.0] * 5, limit=3.0)
    assert prepare(arm, 'position', 2).form is None
    assert not query(arm, np.array([[4.9, 0.0, 0.0]]), order=2)[0].closed_form


@pytest.mark.parametrize('order', [1, 2, 3])
def test_maps_of_any_order(order):
    arm = planar(*[1.0] * (2 * order + 2))
    frame = map_frame(arm, 'xy')
    built = build_map(arm, frame, low=[-3, -3], high=[3, 3], depth=6, order=order)
    lower, upper = built.measure()
    assert lower < 4.0 * np.pi < upper and upper - lower < 2.5
    rng = np.random.default_rng(order)
    for point in rng.uniform(-2.5, 2.5, (200, 3)) * [1.0, 1.0, 0.0]:
        inside = np.linalg.norm(point) <= 2.0
        wrong = Verdict.NON_MEMBER if inside else Verdict.MEMBER
        assert built.lookup(point) is not wrong


@pytest.mark.parametrize('order', [1, 2])
def test_poses_agree_with_covering_and_search(order):
    rng = np.random.default_rng(30 + order)
    codes = []
    for trial in range(4):
        n = 2 * order + 3
        lengths = rng.uniform(0.3, 1.0, n) * [*[1.0] * (n - 1), trial % 2]
        arm = planar(*lengths)
        problem = prepare(arm, 'pose', order)
        length = problem.task.length
        tolerance = SETTINGS.effort(True, length).tolerance
        for radius in rng.uniform(0.0, 0.5 * lengths.sum(), 3):
            angle, turned = rng.uniform(-np.pi, np.pi, 2)
            point = radius * np.array([np.cos(angle), np.sin(angle), 0.0])
            row = np.array([*point, np.cos(turned / 2), 0.0, 0.0, np.sin(turned / 2)])
            mine = judge_planar(problem.form, row, 0.0, tolerance, 0.0, problem.ranges)
            codes.append(mine.code)
            if order == 1:
                effort = SETTINGS.effort(True, length)
                covered = int(run_engine(problem, row[None], effort).verdicts[0])
                assert covered in (0, mine.code), (lengths, row)
            worst = dict(zip(problem.combos[mine.combo].tolist(), mine.angles, strict=False))
            if mine.code == NON_MEMBER:
                found = closest(arm, point, worst, rng, 4, turned, length, 0.0)
                assert found >= mine.residual - 1e-9
            else:
                combo = problem.combos[rng.integers(len(problem.combos))].tolist()
                frozen = dict(zip(combo, rng.uniform(-np.pi, np.pi, order), strict=True))
                assert closest(arm, point, frozen, rng, 30, turned, length) < 1e-7
    assert {MEMBER, NON_MEMBER} <= set(codes)
