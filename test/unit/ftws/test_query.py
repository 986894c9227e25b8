"""Verdicts against the closed forms and statements of the paper."""

from dataclasses import replace

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.goal import Goal
from unit.ftws.arms import planar, table_1, table_1_distance

VERDICT_ONLY = FtwsSettings(intervals=False)
MEMBER, NON_MEMBER = Verdict.MEMBER, Verdict.NON_MEMBER


def verdicts(arm, points, **kwargs):
    settings = kwargs.pop('settings', VERDICT_ONLY)
    return [r.verdict for r in query(arm, np.array(points, float), settings=settings, **kwargs)]


def turned(x, y, angle):
    return [x, y, 0.0, 0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)]


def test_table_1_agrees_with_its_closed_form_everywhere():
    rng = np.random.default_rng(11)
    for _ in range(3):
        a, b = rng.uniform(-1.0, 1.0, 2)
        scale = rng.uniform(0.3, 3.0)
        points = rng.uniform(-2.6, 2.6, (120, 3)) * scale
        distance = table_1_distance(points, scale) / scale
        answers = verdicts(table_1(a, b, scale), points)
        for point, d, answer in zip(points, distance, answers, strict=True):
            assert answer is not (NON_MEMBER if d <= 0.0 else MEMBER), (point, d)
            assert answer is not Verdict.UNDECIDED or abs(d) < 1e-3, (point, d)


def test_the_three_points_of_equation_11_are_members_of_table_3():
    points = [[0.5, 0.0, 0.5], [0.0, 0.5, 0.25], [0.75, 0.0, 0.5]]
    assert verdicts(load_arm('paredis_table_3'), points) == [MEMBER] * 3


def test_planar_4r_is_the_disc_of_radius_2():
    arm = planar(1.0, 1.0, 1.0, 1.0)
    inside = [[0.4, 0.0, 0.0], [0.0, -1.2, 0.0], [1.99, 0.0, 0.0], [-1.4, 1.4, 0.0]]
    outside = [[2.01, 0.0, 0.0], [0.0, 2.5, 0.0], [1.43, 1.43, 0.0], [1.0, 0.0, 0.01]]
    assert verdicts(arm, inside) == [MEMBER] * 4
    assert verdicts(arm, outside) == [NON_MEMBER] * 4


def test_planar_3r_has_no_member_off_the_unit_circle_and_is_never_refuted_on_it():
    arm = planar(1.0, 1.0, 1.0)
    angles = np.linspace(0.0, 6.0, 7)
    on = np.stack([np.cos(angles), np.sin(angles), np.zeros(7)], axis=1)
    assert NON_MEMBER not in verdicts(arm, on)
    assert verdicts(arm, 0.99 * on) == [NON_MEMBER] * 7
    assert verdicts(arm, 1.01 * on) == [NON_MEMBER] * 7


def test_equation_5_planar_5r_with_orientation():
    arm = load_arm('planar_5r')
    inside = [turned(1.0, 0.5, 0.3), turned(-1.9, 0.0, 2.0), turned(0.0, 0.3, -3.0)]
    outside = [turned(2.02, 0.0, 2.0), turned(1.5, 1.5, 0.0)]
    assert verdicts(arm, inside, mode='pose') == [MEMBER] * 3
    assert verdicts(arm, outside, mode='pose') == [NON_MEMBER] * 2


def test_order_2_of_planar_6r_again_reaches_2():
    arm = planar(*[1.0] * 6)
    assert verdicts(arm, [[1.3, 0.2, 0.0], [2.03, 0.0, 0.0]], order=2) == [MEMBER, NON_MEMBER]


@pytest.mark.parametrize('limit', [170.0, 160.0, 155.0])
def test_table_1_with_limits_shrinks(limit):
    arm = table_1(limit_deg=limit)
    answers = verdicts(arm, [[0.8, 0.0, 0.8], [0.0, 0.0, 0.0]])
    assert answers[0] is (MEMBER if limit == 170.0 else NON_MEMBER)
    assert answers[1] is NON_MEMBER  # the central hole


def test_table_1_with_150_degrees_is_empty():
    rho, z = np.meshgrid(np.linspace(0.0, 2.4, 9), np.linspace(-2.0, 2.0, 9))
    points = np.stack([rho.ravel(), np.zeros(81), z.ravel()], axis=1)
    assert MEMBER not in verdicts(table_1(limit_deg=150.0), points)


def test_same_answers_for_any_thread_count_and_order():
    arm = table_1(limit_deg=170.0)
    points = np.random.default_rng(5).uniform(-2.0, 2.0, (24, 3))
    shuffle = np.random.default_rng(6).permutation(24)

    def answers(rows, threads):
        return [
            (r.verdict, r.joints, r.angles, r.residual, r.tolerated)
            for r in query(arm, rows, threads=threads)
        ]

    one = answers(points, 1)
    assert answers(points, 2) == one
    assert answers(points[shuffle], 2) == [one[i] for i in shuffle]


def test_tolerated_intervals_hold_where_closed_form_says_so():
    # Planar 3R, goal at 1.5: joint 1 frozen at phi leaves a disc of radius 2 around its tip.
    result = query(planar(1.0, 1.0, 1.0), np.array([[1.5, 0.0, 0.0]]))[0]
    assert result.verdict is NON_MEMBER
    limit = np.arccos((1.0 + 1.5**2 - 4.0) / 3.0)
    ((low, high),) = result.tolerated['joint_1']
    assert -limit <= low < -limit + 5e-3 and limit - 5e-3 < high <= limit
    assert result.surviving_fraction['joint_1'] == pytest.approx(limit / np.pi, abs=2e-3)


def test_a_ball_that_is_judged_as_one_is_right_about_its_points():
    arm = table_1()
    settings = FtwsSettings(intervals=False, radius=0.05)
    rng = np.random.default_rng(7)
    centres = rng.uniform(-2.2, 2.2, (40, 3))
    for centre, verdict in zip(centres, verdicts(arm, centres, settings=settings), strict=True):
        step = rng.normal(size=(50, 3))
        ball = centre + 0.05 * step / np.linalg.norm(step, axis=1)[:, None]
        inside = table_1_distance(ball) <= 0.0
        assert verdict is not MEMBER or inside.all()
        assert verdict is not NON_MEMBER or not inside.any()


def test_members_beside_limits_have_a_proved_ball():
    settings = FtwsSettings(intervals=False, margin=True)
    points = np.array([[0.5, 0.0, 0.5], [0.75, 0.0, 0.5], [-0.593, -0.475, 0.501]])
    for answer in query(load_arm('paredis_table_3'), points, settings=settings):
        assert answer.verdict is MEMBER
        assert answer.margin > 1e-4


def test_margins_are_proved_balls():
    arm = table_1()
    settings = FtwsSettings(intervals=False, margin=True)
    inside, outside = query(arm, np.array([[1.0, 0.0, 0.5], [2.3, 0.0, 0.0]]), settings=settings)
    assert 0.0 < inside.margin <= 1.0
    assert 0.0 < outside.margin <= 0.3 + 1e-9


def test_pose_goals_may_leave_the_tool_axis_free():
    goal = Goal(np.array([1.0, 0.5, 0.0]), np.eye(3), free_axis=True)
    result = query(planar(1.0, 1.0, 1.0, 1.0), [goal], mode='pose')[0]
    # The axis is normal to the plane: freeing it makes the pose a position.
    assert result.verdict is MEMBER
    assert set(result.tolerated) == {f'joint_{i}' for i in range(1, 5)}


def test_operating_limits_bound_where_joints_freeze():
    from dataclasses import replace

    arm = planar(1.0, 1.0, 1.0)
    ranges = [(-0.5, 0.5), (0.5, 1.5), (0.5, 1.5)]
    narrow = replace(
        arm,
        joints=tuple(
            replace(joint, operating_lower=lo, operating_upper=hi)
            for joint, (lo, hi) in zip(arm.joints, ranges, strict=True)
        ),
    )
    point = [[1.5, 0.0, 0.0]]
    assert verdicts(arm, point) == [NON_MEMBER]
    assert verdicts(narrow, point) == [MEMBER]


def test_a_spent_time_budget_leaves_goals_undecided():
    settings = FtwsSettings(time_budget=1e-9)
    answers = verdicts(table_1(), np.zeros((3, 3)), settings=settings)
    assert answers == [Verdict.UNDECIDED] * 3


@pytest.mark.parametrize(
    ('points', 'options', 'field'),
    [
        (np.zeros((1, 4)), {}, 'points'),
        (np.array([[0.0, np.nan, 0.0]]), {}, 'points[0]'),
        (np.zeros((1, 3)), {'order': 0}, 'order'),
        (np.zeros((1, 3)), {'order': 5}, 'order'),
        (np.zeros((1, 3)), {'mode': 'speed'}, 'mode'),
        (np.zeros((1, 3)), {'mode': 'pose'}, 'points'),
        (np.zeros((1, 3)), {'threads': 0}, 'threads'),
    ],
)
def test_malformed_questions_name_the_field(points, options, field):
    with pytest.raises(InputError) as error:
        query(table_1(), points, **options)
    assert error.value.field == field


def test_dextrous_planar_arms_are_covered_in_every_orientation():
    arm = load_arm('planar_5r')
    assert verdicts(arm, [[1.0, 0.5, 0.0], [2.1, 0.0, 0.0]], mode='dextrous') == [
        MEMBER,
        NON_MEMBER,
    ]
    # With a last link of its own length, far points are lost in some orientation only.
    arm = planar(1.0, 1.0, 1.0, 1.0, 0.5)
    answer = query(arm, np.array([[1.8, 0.0, 0.0]]), mode='dextrous', settings=VERDICT_ONLY)[0]
    assert answer.verdict is NON_MEMBER and 'orientation' in answer.reason


@pytest.mark.parametrize('mode', ['position', 'dextrous'])
def test_a_ball_about_a_point_off_the_plane_is_no_member(mode):
    ball = replace(VERDICT_ONLY, radius=0.01)
    on, off, far = query(
        load_arm('planar_5r'),
        np.array([[1.0, 0.5, 0.0], [1.0, 0.5, 0.005], [1.0, 0.5, 0.02]]),
        mode=mode,
        settings=ball,
    )
    assert on.verdict is MEMBER
    assert off.verdict is Verdict.UNDECIDED and 'off the plane' in off.reason
    assert far.verdict is NON_MEMBER


def test_table_2_in_sampled_orientations():
    arm = load_arm('paredis_table_2')
    inside, outside = query(
        arm, np.array([[1.0, 0.0, 0.5], [2.4, 0.0, 0.0]]), mode='dextrous', settings=VERDICT_ONLY
    )
    assert inside.verdict is Verdict.UNDECIDED and 'sampled evidence' in inside.reason
    assert '512 of 512' in inside.reason
    assert outside.verdict is NON_MEMBER
