"""Replay of the workspace node: recorded queries in, verdicts out."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from ft_manip_ros.bags.findings import Finding, Value
from ft_manip_ros.bags.joint_blocks import JointBlock
from ft_manip_ros.bags.reader import BagMessage
from ft_manip_ros.bags.replay_setup import ReplaySetup
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict
from ft_manip_ros.nodes.ftws_messages import answer_from_message, goals_from_poses

NODE = 'workspace'
NUMBERS = {'angles': 1e-4, 'residual': 1e-6, 'margin': 1e-6}
_REQUEST_RECEIVED, _RESPONSE_SENT = 1, 2
_SPENT = 'the time budget was spent'


class VerdictReplay:
    """Asks the engine again what the workspace node was asked, without its time budget."""

    def __init__(self, setup: ReplaySetup, *, threads: int = 1) -> None:
        self.recorded: list[Finding] = []
        self.replayed: list[Finding] = []
        self.unanswered = 0
        self.handlers: dict[str, Callable[[BagMessage, Any], None]] = {}
        self.block_handlers: dict[str, Callable[[JointBlock], Iterable[InputError]]] = {}
        self._threads = threads
        self._asked: dict[tuple[bytes, int], tuple[int, list[FtwsResult]]] = {}
        topic = setup.topic(
            'workspace/query_ftws/_service_event', 'ft_manip_interfaces/srv/QueryFtws_Event'
        )
        if topic is not None:
            self._chain = setup.chain(NODE)
            self.handlers[topic] = self._on_event

    def _on_event(self, record: BagMessage, message: Any) -> None:
        key = (bytes(message.info.client_gid), int(message.info.sequence_number))
        if message.info.event_type == _REQUEST_RECEIVED and len(message.request):
            self._asked[key] = (record.log_time, self._judge(message.request[0]))
        elif message.info.event_type == _RESPONSE_SENT and len(message.response):
            asked = self._asked.pop(key, None)
            response = message.response[0]
            if asked is None or not response.success:
                return
            stamp, results = asked
            answers = [answer_from_message(a, response.joint_names) for a in response.answers]
            for i, (old, new) in enumerate(zip(answers, results, strict=False)):
                if old.verdict == Verdict.UNDECIDED and old.reason.startswith(_SPENT):
                    self.unanswered += 1
                    continue
                self.recorded.append(_finding(stamp, i, old))
                self.replayed.append(_finding(stamp, i, new))

    def _judge(self, request: Any) -> list[FtwsResult]:
        mode = request.mode or 'position'
        settings = FtwsSettings(intervals=bool(request.intervals))
        if request.tolerance > 0.0:
            settings = replace(settings, tolerance=float(request.tolerance))
        return query(
            self._chain,
            goals_from_poses(request.poses, mode),
            order=int(request.order) or 1,
            mode=mode,
            settings=settings,
            threads=self._threads,
        )


def _finding(stamp: int, index: int, result: FtwsResult) -> Finding:
    details: dict[str, Value] = {
        'joints': ' '.join(result.joints),
        'angles': tuple(float(a) for a in result.angles),
        'residual': float(result.residual),
        'margin': float(result.margin),
    }
    place = ', '.join(f'{x:.6g}' for x in result.point)
    values = {'verdict': result.verdict.value}
    return Finding('verdict', stamp, f'point {index} ({place})', values, details)
