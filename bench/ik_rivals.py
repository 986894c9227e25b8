"""Other inverse-kinematics libraries, each set up the way that favours it: the ROD is its robot.

None is a dependency of the project: those that are not installed are left out.
"""

from __future__ import annotations

import importlib
import importlib.util
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.pinocchio_model import TOOL_FRAME, model_from_chain
from ft_manip_ros.core.urdf_writer import BASE_LINK, TOOL_LINK, chain_to_urdf

# What every library is asked for (m and rad), and how long it may try (s).
TOLERANCE = 1e-5
PATIENCE = 0.2
# Steps of one descent of the libraries that leave the loop to their caller.
DESCENT = 60

Solver = Callable[[Array], Array]


class Rival(NamedTuple):
    """A library to compare with."""

    module: str  # that must be installed
    set_up: Callable[[SerialChain, Goal], Solver]
    poses_only: bool = False  # positions alone are not among what it solves

    def skipped(self, *, with_pose: bool) -> str:
        """Why it cannot be measured on goals of this kind; empty where it can."""
        if importlib.util.find_spec(self.module) is None:
            return f'{self.module} is not installed'
        return 'it solves poses only' if self.poses_only and not with_pose else ''


def _with_restarts(
    chain: SerialChain, start: Array, descend: Callable[[Array], tuple[bool, Array]]
) -> Array:
    """Descend from the start, then from random postures, until one converges or time is up."""
    rng = np.random.default_rng(0)
    begin = time.perf_counter()
    converged, q = descend(start)
    while not converged and time.perf_counter() - begin < PATIENCE:
        converged, q = descend(rng.uniform(chain.lower, chain.upper))
    return q


def pink(chain: SerialChain, goal: Goal) -> Solver:
    """Pink: a task on the tool frame, solved as a sequence of quadratic programs."""
    library = importlib.import_module('pink')
    tasks = importlib.import_module('pink.tasks')
    limits = importlib.import_module('pink.limits')
    pinocchio = importlib.import_module('pinocchio')
    model = model_from_chain(chain)
    data = model.createData()
    weight = 0.0 if goal.orientation is None else 1.0
    task = tasks.FrameTask(TOOL_FRAME, position_cost=1.0, orientation_cost=weight, lm_damping=1e-3)
    rotation = np.eye(3) if goal.orientation is None else goal.orientation
    task.set_target(pinocchio.SE3(rotation, goal.position))
    limit = limits.ConfigurationLimit(model)
    rows = 6 if weight else 3

    def descend(q: Array) -> tuple[bool, Array]:
        configuration = library.Configuration(model, data, q)
        for _ in range(DESCENT):
            error = task.compute_error(configuration)[:rows]
            if _small(error):
                return True, configuration.q
            try:
                velocity = library.solve_ik(
                    configuration, [task], 1.0, solver='daqp', limits=[limit], safety_break=False
                )
            except library.exceptions.PinkError:
                break
            configuration.integrate_inplace(velocity, 1.0)
        return False, configuration.q

    return lambda start: _with_restarts(chain, start, descend)


def mink(chain: SerialChain, goal: Goal) -> Solver:
    """Mink: the same on MuJoCo."""
    library = importlib.import_module('mink')
    mujoco = importlib.import_module('mujoco')
    compiler = (
        '<mujoco><compiler fusestatic="false" boundmass="0.001" boundinertia="0.000001"/></mujoco>'
    )
    text = chain_to_urdf(chain).replace('</robot>', f'{compiler}</robot>')
    model = mujoco.MjModel.from_xml_string(text)
    weight = 0.0 if goal.orientation is None else 1.0
    task = library.FrameTask(
        TOOL_LINK, 'body', position_cost=1.0, orientation_cost=weight, lm_damping=1e-3
    )
    frame = np.eye(4)
    frame[:3, 3] = goal.position
    if goal.orientation is not None:
        frame[:3, :3] = goal.orientation
    task.set_target(library.SE3.from_matrix(frame))
    limit = library.ConfigurationLimit(model)
    configuration = library.Configuration(model)
    rows = 6 if weight else 3

    def descend(q: Array) -> tuple[bool, Array]:
        configuration.update(q)
        for _ in range(DESCENT):
            error = task.compute_error(configuration)[:rows]
            if _small(error):
                return True, configuration.q.copy()
            try:
                velocity = library.solve_ik(
                    configuration, [task], 1.0, solver='daqp', limits=[limit]
                )
            except library.MinkError:
                break
            configuration.integrate_inplace(velocity, 1.0)
        return False, configuration.q.copy()

    return lambda start: _with_restarts(chain, start, descend)


def robotics_toolbox(chain: SerialChain, goal: Goal) -> Solver:
    """Robotics Toolbox for Python: `ik_LM`, in C++, with its own restarts."""
    library = importlib.import_module('roboticstoolbox')
    spatial = importlib.import_module('spatialmath')
    terms = []
    for i in range(chain.n + 1):
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = chain.rotations[i], chain.translations[i]
        terms.append(library.ET.SE3(spatial.SE3(frame, check=False)))
        if i < chain.n:
            joint = chain.joints[i]
            kind = library.ET.tz if joint.prismatic else library.ET.Rz
            terms.append(kind(qlim=[joint.lower, joint.upper]))
    ets = library.ETS(terms)
    target = np.eye(4)
    target[:3, 3] = goal.position
    if goal.orientation is not None:
        target[:3, :3] = goal.orientation
    mask = np.array([1, 1, 1, 0, 0, 0] if goal.orientation is None else [1] * 6, dtype=float)

    def solve(start: Array) -> Array:
        # Its tolerance is on half the squared error.
        answer = ets.ik_LM(
            target, q0=start, tol=0.5 * TOLERANCE**2, mask=mask, joint_limits=True, slimit=1000
        )
        return np.asarray(answer[0] if isinstance(answer, tuple) else answer.q, dtype=float)

    return solve


def trac_ik(chain: SerialChain, goal: Goal) -> Solver:
    """TRAC-IK through pytracik; it solves poses only."""
    library = importlib.import_module('trac_ik')
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'rod.urdf'
        path.write_text(chain_to_urdf(chain))
        solver = library.TracIK(BASE_LINK, TOOL_LINK, str(path), PATIENCE, TOLERANCE)

    def solve(start: Array) -> Array:
        answer = solver.ik(goal.position, goal.orientation, seed_jnt_values=start)
        return start if answer is None else np.asarray(answer, dtype=float)

    return solve


def _small(error: Array) -> bool:
    return bool(np.linalg.norm(error[:3]) <= TOLERANCE and np.linalg.norm(error[3:]) <= TOLERANCE)


RIVALS = {
    'TRAC-IK (pytracik)': Rival('trac_ik', trac_ik, poses_only=True),
    'Robotics Toolbox ik_LM': Rival('roboticstoolbox', robotics_toolbox),
    'Pink': Rival('pink', pink),
    'Mink': Rival('mink', mink),
}
