"""All decisions of the re-planner, without ROS: events in, plans out; a bag can drive it too."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import Task
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.decision import Decision, ExecutiveSettings, Visited, cause_of
from ft_manip_ros.core.planning.handover import Handover
from ft_manip_ros.core.planning.measured import MeasuredStates
from ft_manip_ros.core.planning.progress import SECOND, Progress
from ft_manip_ros.core.planning.proof import Proof
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.planning.trajectory import Trajectory

# States that may be passed over as too old before one is planned from all the same.
_PASSED_OVER = 20


class Executive:
    """Keeps the task, what of it is done, the measured state, and the frozen joints.

    Stamps are those of messages, in ns. Every method may raise `InputError`; nothing has then
    changed.

    Parameters
    ----------
    chain
        The full arm.
    planning, watching
        Settings.
    checker
        Of bodies that must not touch; None: nothing is checked.
    clock
        Returns now (ns) on the clock of the stamps; None: as a replay, no state is too old for
        having waited, and planning takes no time.
    send_stop
        Called where a moving arm has to stop before a plan that will take a while: with the
        trajectory, and the stamp (ns) of the state that it starts from. Needs a clock.
    """

    def __init__(
        self,
        chain: SerialChain,
        planning: PlanSettings | None = None,
        watching: ExecutiveSettings | None = None,
        checker: CollisionChecker | None = None,
        clock: Callable[[], int] | None = None,
        send_stop: Callable[[Trajectory, int], None] | None = None,
    ) -> None:
        self.chain = chain
        self.planning = planning or PlanSettings()
        self.watching = watching or ExecutiveSettings()
        self._checker = checker
        self.frozen: dict[str, float] = {}
        self.sigma: dict[str, float] = {}
        self._runaway: tuple[str, ...] = ()
        self._untrusted: tuple[str, ...] = ()
        self._clock = clock
        self._send_stop = send_stop
        self._states = MeasuredStates(chain, self.watching.velocity_window)
        self._progress: Progress | None = None
        self._waiting: str | None = None
        self._passed_over = 0
        self._retries = 0
        self._latest: Decision | None = None

    @property
    def task(self) -> Task | None:
        """The task being executed."""
        return None if self._progress is None else self._progress.task

    @property
    def remaining(self) -> tuple[int, ...]:
        """Places of the goals that the tool has not been measured at yet."""
        return () if self._progress is None else tuple(self._progress.remaining)

    @property
    def waiting(self) -> bool:
        """Whether a plan is owed as soon as a state comes that is young enough."""
        return self._waiting is not None

    def on_task(self, task: Task) -> Decision | None:
        """Take up a new task; it replaces the one before.

        Returns None where no usable state has been measured yet: the plan is then made with the
        first one.
        """
        self._progress = Progress(task)
        self._retries = 0
        return self._decide(f'task {task.name!r}')

    def on_joint_state(
        self,
        stamp: int,
        positions: Mapping[str, float],
        velocities: Mapping[str, float] | None = None,
    ) -> tuple[list[Visited], Decision | None]:
        """Take in one measured state of the whole arm; joints of others may be in it.

        A frozen joint stands where it is frozen, whatever is read of it, if anything.

        Raises
        ------
        InputError
            For another joint of the arm that is missing, NaN, or where no joint can stand.
        """
        positions = {**positions, **self.frozen}
        if velocities is not None:
            velocities = {**velocities, **dict.fromkeys(self.frozen, 0.0)}
        if not self._states.add(stamp, positions, velocities):
            return [], None
        progress = self._progress
        visited = progress.watch(self.chain, stamp, self._states.position) if progress else []
        if self._waiting:
            return visited, self._decide(self._waiting)
        return visited, self._retry(stamp)

    def on_fault_state(
        self,
        stamp: int,
        frozen: Mapping[str, float],
        sigma: Mapping[str, float],
        runaway: tuple[str, ...] = (),
        untrusted: tuple[str, ...] = (),
    ) -> Decision | None:
        """Take in which joints are frozen (positions and standard deviations) or run away.

        Plans anew when that changed while goals remain: a further failure during recovery, or a
        joint that was cleared. Returns None otherwise, and where the newest measured state is
        too old, or was measured while a joint was frozen that is not any more: the plan is then
        made with the next one. While a joint runs away the plan is to stand still; while the
        readings of one are not believed (``untrusted``), goals that were missed are not tried
        again: where the tool is, and where a plan would start from, is not known.
        """
        for name, value in frozen.items():
            self.chain.index(name)
            if not np.isfinite(value):
                raise InputError(f'frozen joint {name!r}', f'stands at {value}; must be finite')
        for name in runaway:
            self.chain.index(name)
        self._untrusted = untrusted
        if dict(frozen) == self.frozen and runaway == self._runaway:
            return None
        new = {name: at for name, at in frozen.items() if name not in self.frozen}
        back = [name for name in self.frozen if name not in frozen]
        self.frozen, self._runaway = dict(frozen), runaway
        # A standard deviation that cannot be one is as good as none.
        self.sigma = {
            name: value if np.isfinite(value := sigma.get(name, 0.0)) and value >= 0.0 else 0.0
            for name in frozen
        }
        if back:
            # What was noted of a frozen joint is where it was frozen; it is measured from now on.
            self._states.clear()
        if self._progress is None:
            return None
        self._retries = 0
        return self._decide(cause_of(new, back, runaway), now=stamp)

    def on_proof(self, decision: Decision, proof: Proof) -> Decision | None:
        """Take in what `prove` made of the plan of a decision.

        Returns the decision with its better report, or a new one where postures were found that
        the plan had missed; None where nothing changed, or the decision has been overtaken.
        """
        if decision is not self._latest:
            return None
        progress = self._progress
        new = [] if progress is None else [k for k in proof.found if k not in progress.hints]
        if new and progress is not None:
            progress.hints.update(proof.found)
            return self._decide(f'postures were found for {progress.names(new)}')
        if proof.plan.outcomes == decision.plan.outcomes:
            return None
        self._latest = replace(decision, plan=proof.plan, restated=True)
        return self._latest

    def _retry(self, stamp: int) -> Decision | None:
        """Plan again for goals whose time has long passed without the tool being there."""
        progress = self._progress
        if progress is None or self._untrusted or self._retries >= self.watching.retries:
            return None
        missed = progress.missed(stamp - round(self.watching.patience * SECOND))
        if not missed:
            return None
        self._retries += 1
        return self._decide(f'not met at their time: {progress.names(missed)}')

    def _decide(self, cause: str, now: int | None = None) -> Decision | None:
        progress = self._progress
        self._waiting = None
        if progress is None or not progress.remaining:
            return None
        if not self._states or self._is_old(now):
            self._waiting = cause
            return None
        self._passed_over = 0
        stamp = self._states.stamp
        plan = plan_task(
            self.chain,
            progress.goals_left(),
            frozen=self.frozen,
            sigma=self.sigma,
            start=self._states.position,
            start_velocity=self._states.velocity,
            settings=self.planning,
            hints=progress.hints,
            checker=self._checker,
            halt=f'{", ".join(self._runaway)} runs away' if self._runaway else '',
            handover=self._handover(stamp),
        )
        progress.promise(plan, stamp)
        self._latest = Decision(plan, stamp, cause, bool(self.frozen))
        return self._latest

    def _handover(self, stamp: int) -> Handover | None:
        """Return what to do while a plan is made that starts from the state of ``stamp`` (ns)."""
        clock, send_stop = self._clock, self._send_stop
        if clock is None or send_stop is None:
            return None
        begin = clock()
        # The clock of the stamps may be another one: states older than that are not planned from.
        waited = min(max((begin - stamp) / SECOND, 0.0), self.watching.freshness)
        return Handover(
            lambda motion: send_stop(motion, stamp),
            lambda: waited + (clock() - begin) / SECOND,
        )

    def _is_old(self, now: int | None) -> bool:
        """Whether to wait for a newer state; ``now`` is the stamp of what asks for a plan (ns).

        A controller skips what of a trajectory has passed when it comes, goals included. So a
        state that has waited to be looked at is not planned from while newer ones are on their
        way; but not for ever, for the clock of the stamps may be another one.
        """
        stamp, watching = self._states.stamp, self.watching
        if now is not None and now - stamp > round(watching.state_timeout * SECOND):
            return True
        if self._clock is None or self._states.period > watching.freshness:
            return False
        age = (self._clock() - stamp) / SECOND
        if age <= watching.freshness or self._passed_over >= _PASSED_OVER:
            return False
        self._passed_over += 1
        return True
