"""Node `designer`: searches for an arm that reaches a task whichever joint locks."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from std_msgs.msg import Header, String
from visualization_msgs.msg import MarkerArray

from ft_manip_interfaces.action import DesignArm
from ft_manip_interfaces.msg import DesignCandidate
from ft_manip_interfaces.msg import Task as TaskMessage
from ft_manip_ros.core.design.job import DesignJob
from ft_manip_ros.core.design.warm_up import warm_up
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.task_file import load_task
from ft_manip_ros.core.urdf_writer import chain_to_urdf
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import task_from_message
from ft_manip_ros.nodes.design_markers import design_markers
from ft_manip_ros.nodes.design_messages import (
    Request,
    candidate_to_message,
    feedback,
    make_header,
    make_request,
    request_from_goal,
    result_to_message,
)
from ft_manip_ros.nodes.design_parameters import (
    PARAMETERS,
    read_files,
    read_settings,
    read_specification,
)
from ft_manip_ros.nodes.managed_node import ManagedNode
from ft_manip_ros.nodes.process import run

_PERIOD = 0.05  # s, between two looks at the running search
_FEEDBACK_PERIOD = 0.2  # s
_STOP_TIME = 1.0  # s, what a search is given to end before the node goes on without it


class Designer(ManagedNode):
    """Runs one search at a time, started by parameter, by a task message or by an action goal."""

    def __init__(self) -> None:
        # An action goal waits in a thread of its own; its cancel comes in by another.
        super().__init__('designer', PARAMETERS, threads=4)
        self._lock = threading.Lock()
        self._job: DesignJob | None = None
        self._request: Request | None = None
        self._announced = True
        self._serving = False
        self._action: ActionServer | None = None

    def configure(self) -> None:
        """Read the task and open topics and action."""
        self._task = load_task(self.param('task'))
        self._settings = read_settings(self)
        self._spec = read_specification(self, self._task)
        self._files = read_files(self)
        self._first = make_request(self._task, self._spec, self._settings)
        self._frame = self.param('frame')
        self._candidates = self.advertise(
            DesignCandidate, topics.DESIGN_CANDIDATES, topics.HISTORY_QOS
        )
        self._best = self.advertise(DesignCandidate, topics.DESIGN_BEST, topics.LATCHED_QOS)
        self._final = self.advertise(DesignCandidate, topics.DESIGN_FINAL, topics.LATCHED_QOS)
        self._markers = self.advertise(MarkerArray, topics.markers('designer'), topics.LATCHED_QOS)
        self._urdf = self.advertise(String, topics.ROBOT_DESCRIPTION, topics.LATCHED_QOS)
        self.subscribe(TaskMessage, topics.TASK, self._on_task, topics.LATCHED_QOS)
        self._action = ActionServer(
            self,
            DesignArm,
            topics.DESIGN_ARM,
            self._execute,
            callback_group=ReentrantCallbackGroup(),
            goal_callback=self._on_goal,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        self.every(_PERIOD, self._report)

    def warm_up(self) -> None:
        """Compile what the first search, and its markers, would wait for."""
        problem = self._first.problem
        warm_up(problem)
        arm = problem.table(0.5 * (problem.space.lower + problem.space.upper))
        design_markers(arm.chain(), self._task, self._header())

    def activate(self) -> None:
        """Start searching where the parameters say so."""
        if self.param('run_at_start'):
            self._begin(self._first)

    def deactivate(self) -> None:
        """End a running search."""
        self._end()

    def release(self) -> None:
        """End a running search and close the action."""
        self._end()
        if self._action is not None:
            self._action.destroy()
            self._action = None

    def _begin(self, request: Request) -> DesignJob:
        self._end()
        with self._lock:
            self._request = request
            self._announced = False
            self._job = DesignJob(request.task, request.spec, request.settings, **self._files)
            job = self._job
        n, order = request.spec.dof, request.spec.order
        self.get_logger().info(
            f'searching for {n} joints that reach {len(request.task.goals)} goals of '
            f'{request.task.name!r} with any {order} of them locked, seed '
            f'{request.settings.seed}, for up to {request.settings.time_budget:g} s'
        )
        return job

    def _end(self) -> None:
        with self._lock:
            job, self._job = self._job, None
        if job is not None:
            job.stop()
            job.wait(_STOP_TIME)

    def _on_task(self, message: TaskMessage) -> None:
        task = task_from_message(message)
        if self._serving:
            raise InputError('task', f'{task.name!r} comes while an action goal is worked on')
        self._begin(make_request(task, self._spec, self._settings))

    def _on_goal(self, goal: DesignArm.Goal) -> GoalResponse:
        if not self.active or self._serving:
            why = 'another goal is worked on' if self._serving else 'the node is not active'
            self.complain(topics.DESIGN_ARM, f'{topics.DESIGN_ARM}: goal rejected: {why}')
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _execute(self, handle: ServerGoalHandle) -> DesignArm.Result:
        self._serving = True
        try:
            request = request_from_goal(handle.request, self._settings)
        except InputError as error:
            handle.abort()
            return DesignArm.Result(reason=str(error))
        else:
            return self._serve(handle, request)
        finally:
            self._serving = False

    def _serve(self, handle: ServerGoalHandle, request: Request) -> DesignArm.Result:
        job = self._begin(request)
        while not job.wait(_FEEDBACK_PERIOD):
            if handle.is_cancel_requested:
                job.stop()
            if not self.active:
                # Deactivated or stopping: the search was told, and nobody may hear feedback.
                continue
            handle.publish_feedback(feedback(job))
        message = DesignArm.Result(elapsed=job.elapsed)
        result = job.result
        if result is None:
            message.reason = f'the search failed: {job.error}'
            handle.abort()
            return message
        message.proved = result.proved
        message.reason = result.reason
        message.candidate = result_to_message(request, result, self._header())
        message.urdf = chain_to_urdf(result.table.chain())
        if handle.is_cancel_requested:
            handle.canceled()
        elif self._job is not job and not result.proved:
            handle.abort()
        else:
            handle.succeed()
        return message

    def _report(self) -> None:
        """Publish what the running search has found since the last look."""
        with self._lock:
            job, request = self._job, self._request
        if job is None or request is None or self._announced:
            return
        done = job.done
        best = None
        for candidate, is_best in job.take_news():
            reason = f'accepted at iteration {candidate.iteration}'
            self._candidates.publish(
                candidate_to_message(
                    request, candidate, DesignCandidate.CANDIDATE, reason, self._header()
                )
            )
            best = candidate if is_best else best
        if best is not None:
            reason = f'lowest penalty of {best.iteration} tables so far'
            self._best.publish(
                candidate_to_message(request, best, DesignCandidate.BEST, reason, self._header())
            )
        if done:
            self._announced = True
            self._announce(job, request)

    def _announce(self, job: DesignJob, request: Request) -> None:
        result = job.result
        if result is None:
            self.get_logger().error(f'the search failed: {job.error}')
            return
        self._final.publish(result_to_message(request, result, self._header()))
        table = result.table
        self._markers.publish(design_markers(table.chain(), request.problem.task, self._header()))
        if result.proved:
            self._urdf.publish(String(data=chain_to_urdf(table.chain())))
        rows = '; '.join(
            f'{table.joints[i].name} d={table.d[i]:.4f} a={table.a[i]:.4f} '
            f'alpha={table.alpha[i]:.4f}'
            for i in range(table.n)
        )
        word = 'proved design' if result.proved else 'NO PROVED DESIGN, best so far'
        self.get_logger().info(
            f'{word} after {result.elapsed:.2f} s and {result.iterations} tables: {result.reason}.'
            f' {rows}'
        )

    def _header(self) -> Header:
        return make_header(self.get_clock().now().nanoseconds, self._frame)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    return run(Designer, args)


if __name__ == '__main__':
    sys.exit(main())
