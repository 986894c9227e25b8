"""Certificates' curves and bounds against a task map written in NumPy and SciPy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ft_manip_ros.core.ftws.certify import error_bound, holds, room, set_box, widest
from ft_manip_ros.core.ftws.local_model import evaluate, make_model
from ft_manip_ros.core.ftws.remainder import third_order_bound
from ft_manip_ros.core.ftws.slopes import bend
from ft_manip_ros.core.ftws.task_map import task_arrays
from ft_manip_ros.core.ftws.taylor import build, make_scratch
from ft_manip_ros.core.ftws.turn_series import CURVE
from support.chains import random_chain


def residual(chain, task, goal, q):
    """Task map of an arm; the error stays far below a half turn."""
    turn, place = np.eye(3), np.zeros(3)
    for i, joint in enumerate(chain.joints):
        place = place + turn @ chain.translations[i]
        turn = turn @ chain.rotations[i]
        if joint.prismatic:
            place = place + turn[:, 2] * q[i]
        else:
            c, s = np.cos(q[i]), np.sin(q[i])
            turn = turn @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    place = place + turn @ chain.translations[-1]
    position = task.position_rows @ (place - goal[:3])
    if len(task.orientation_rows) == 0:
        return position
    wanted = Rotation.from_quat(np.roll(goal[3:], -1))
    x, y, z, w = (Rotation.from_matrix(turn @ chain.rotations[-1]) * wanted.inv()).as_quat()
    error = 2.0 * np.sign(w) * np.array([x, y, z])
    return np.concatenate([position, task.length * task.orientation_rows @ error])


class Piece:
    """A random arm at a random posture, with some joints frozen and everything built."""

    def __init__(self, seed, mode, frozen=1, balls=False):
        self.rng = rng = np.random.default_rng(seed)
        rows = 3 if mode == 'position' else 6
        self.chain = chain = random_chain(rng, joints=rows + frozen + int(rng.integers(0, 3)))
        self.arrays, self.task = chain.arrays, task_arrays(chain, mode, None)
        self.q = rng.uniform(-0.5, 0.5, chain.n)
        self.goal = np.concatenate([rng.normal(size=3), [1.0, 0.0, 0.0, 0.0]])
        self.s = s = make_scratch(chain.n, rows, frozen, mode == 'pose')
        if mode == 'pose':
            # A goal near the tool, so that the error quaternion keeps its sign.
            evaluate(self.arrays, self.task, self.goal, self.q, s.model)
            near = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, 3))
            x, y, z, w = (near * Rotation.from_matrix(s.model.tip_rotation)).as_quat()
            self.goal[3:] = w, x, y, z
        evaluate(self.arrays, self.task, self.goal, self.q, s.model)
        self.combo = np.sort(rng.choice(chain.n, frozen, replace=False))
        self.free = np.ones(chain.n, bool)
        self.free[self.combo] = False
        jacobian = s.model.jacobian * self.free
        self.usable = np.linalg.cond(jacobian) < 300.0
        if self.usable:
            s.inverse[:] = np.linalg.pinv(jacobian)
            build(self.arrays, self.task, self.combo, balls, s)
        self.start = self.residual(self.q)

    def residual(self, q):
        return residual(self.chain, self.task, self.goal, q)

    def posture(self, delta, y):
        """Posture of the family: changes of the frozen joints (k,) and correction (m,)."""
        x = self.q + self.s.inverse @ y
        for i in range(CURVE):
            x = x + self.s.directions[i] * delta[0] ** (i + 1)
        return x + delta[1:] @ self.s.directions[CURVE:]


def pieces(mode, frozen=1, seeds=40, balls=False):
    made = [Piece(seed, mode, frozen, balls) for seed in range(seeds)]
    made = [piece for piece in made if piece.usable]
    assert len(made) > seeds // 4
    return made


@pytest.mark.parametrize('mode', ['position', 'pose'])
def test_the_curve_holds_the_goal_to_its_order(mode):
    for piece in pieces(mode):
        zero = np.zeros(len(piece.start))
        scale = np.abs(piece.s.directions).sum(axis=1)
        h = 0.05 / max(scale[i] ** (1.0 / (i + 1)) for i in range(CURVE))
        missed = [
            np.linalg.norm(piece.residual(piece.posture(np.array([step]), zero)) - piece.start)
            for step in (h, 0.5 * h)
        ]
        assert (piece.s.defects < 1e-9 * (1.0 + scale[:CURVE])).all()
        # The order above the last one cancelled: a step half as long misses by 2^-5 of it.
        assert missed[1] < missed[0] * 0.5 ** (CURVE + 0.5) + 1e-14


@pytest.mark.parametrize('mode', ['position', 'pose'])
def test_second_derivatives_are_differences_of_the_jacobian(mode):
    for piece in pieces(mode, seeds=15):
        d = piece.rng.normal(size=piece.chain.n)
        found = np.zeros_like(piece.s.model.jacobian)
        bend(piece.arrays, piece.task, piece.s.model, d, found)
        model, sides = make_model(piece.chain.n, len(piece.start)), []
        for sign in (-1e-6, 1e-6):
            evaluate(piece.arrays, piece.task, piece.goal, piece.q + sign * d, model)
            sides.append(model.jacobian.copy())
        assert found == pytest.approx((sides[1] - sides[0]) / 2e-6, abs=1e-7)


def test_slopes_along_the_curve_are_those_of_the_jacobian():
    for piece in pieces('position', seeds=15):
        model, sides = make_model(piece.chain.n, 3), []
        for step in (-1e-3, 0.0, 1e-3):
            x = piece.posture(np.array([step]), np.zeros(3))
            evaluate(piece.arrays, piece.task, piece.goal, x, model)
            sides.append(model.jacobian.copy())
        second = (sides[0] - 2.0 * sides[1] + sides[2]) / 2e-6
        size = 1.0 + np.abs(piece.s.slope).max() ** 2
        assert piece.s.slope == pytest.approx(second, abs=1e-4 * size)


@pytest.mark.parametrize('balls', [False, True])
@pytest.mark.parametrize(('mode', 'frozen'), [('position', 1), ('position', 2), ('pose', 1)])
def test_the_bound_holds_over_the_whole_box(mode, frozen, balls):
    nearest = checked = 0.0
    for piece in pieces(mode, frozen, balls=balls):
        rng = piece.rng
        for _ in range(40):
            halves = rng.uniform(0.2, 1.0, frozen) * 10 ** rng.uniform(-3.0, -0.3)
            rho = 10 ** rng.uniform(-5.0, -0.5) * rng.integers(0, 2)
            set_box(piece.arrays, piece.task, halves, piece.s)
            bound = error_bound(piece.arrays, piece.task, halves, rho, piece.s)
            if not bound < 10.0:
                continue
            for _ in range(4):
                delta = halves * rng.choice([-1.0, 1.0], frozen)
                y = rng.normal(size=len(piece.start))
                y *= rho / np.linalg.norm(y)
                x = piece.posture(delta, y)
                left = np.linalg.norm(piece.residual(x) - piece.start - y)
                assert left <= bound * (1.0 + 1e-9) + 1e-12
                assert (np.abs(x - piece.q) <= piece.s.box + piece.s.reach * rho + 1e-12).all()
                checked += 1
                if bound > 1e-9:
                    nearest = max(nearest, left / bound)
    assert checked > 500
    assert nearest > 0.5  # no bound that holds by being large


def test_a_certified_piece_has_its_postures():
    """Newton from the family finds the goal everywhere within the half-width, inside limits."""
    found = 0
    for piece in pieces('position'):
        halves = np.zeros(1)
        goal_start = np.linalg.norm(piece.s.model.residual)
        piece.goal[:3] += piece.start  # the posture reaches it exactly
        start = 1e-12 * (1.0 + goal_start)
        h = widest(
            piece.arrays, piece.task, piece.q, piece.free, halves, start, 0.1, 1e-5, piece.s
        )
        if h == 0.0:
            continue
        found += 1
        rho = holds(piece.arrays, piece.task, piece.q, piece.free, halves, start, piece.s)
        assert rho > 0.0
        assert room(piece.arrays, piece.q, piece.free, rho, piece.s) >= 1.0
        for delta in np.linspace(-h, h, 7):
            y = np.zeros(3)
            for _ in range(60):  # the very iteration of the proof
                y = y - piece.residual(piece.posture(np.array([delta]), y))
                assert np.linalg.norm(y) <= rho
            assert np.linalg.norm(piece.residual(piece.posture(np.array([delta]), y))) < 1e-9
            x = piece.posture(np.array([delta]), y)
            inside = (piece.chain.lower <= x) & (x <= piece.chain.upper)
            assert (inside | piece.arrays.wraps | ~piece.free).all()
    assert found > 10


@pytest.mark.parametrize('mode', ['position', 'pose'])
def test_third_order_bound_holds_over_a_box(mode):
    nearest = 0.0
    for piece in pieces(mode, seeds=20):
        length = piece.task.length if mode == 'pose' else 0.0
        evaluate(piece.arrays, piece.task, piece.goal, piece.q, piece.s.model)
        for _ in range(20):
            half = piece.rng.uniform(0.0, 0.3, piece.chain.n)
            bound = third_order_bound(piece.arrays, piece.s.model.distance, length, half)
            d = half * piece.rng.choice([-1.0, 1.0], piece.chain.n)
            times = np.cos(np.pi * (np.arange(17) + 0.5) / 17)
            values = np.array([piece.residual(piece.q + t * d) for t in times])
            fit = [np.polynomial.Polynomial.fit(times, v, 14, domain=[-1, 1]) for v in values.T]
            for at in (0.0, 0.7):
                third = np.linalg.norm([series.deriv(3)(at) for series in fit])
                assert third <= bound * (1.0 + 1e-6) + 1e-7
                nearest = max(nearest, third / bound)
    assert nearest > 0.3
