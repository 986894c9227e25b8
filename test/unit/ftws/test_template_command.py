"""`ftmanip template`: the smallest template that covers a task, proved, or a clear refusal."""

import json

import numpy as np
import pytest

from ft_manip_ros.cli.main import main
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.templates import in_template
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.task_file import load_task

TASK = 'paredis_table_1_points'


def test_the_arm_covers_the_task_and_hardly_more(tmp_path, capsys):
    output = tmp_path / 'arm.yaml'
    command = ['template', TASK, '--clearance', '0.01', '--json', '--output', str(output)]
    assert main(command) == 0
    answer = json.loads(capsys.readouterr().out)
    points = np.array([goal.position for goal in load_task(TASK).goals])
    assert answer['template'] == 'paredis_table_1'
    assert answer['verdicts'] == ['member'] * len(points)
    smallest = answer['scale'] - 0.01
    assert in_template(points, smallest * (1.0 + 1e-9)).all()
    assert not in_template(points, smallest * (1.0 - 1e-6)).all()
    arm = load_arm(str(output))
    # The goal farthest out has its clearance, and not ten times that.
    outermost = points[np.argmax(np.linalg.norm(points, axis=1))]
    outward = outermost / np.linalg.norm(outermost)
    near, far = query(arm, outermost + np.outer([0.009, 0.1], outward))
    assert (near.verdict, far.verdict) == (Verdict.MEMBER, Verdict.NON_MEMBER)


def test_a_person_reads_scale_and_verdicts(capsys):
    assert main(['template', TASK, '--clearance', '0.05']) == 0
    told = capsys.readouterr().out
    assert told.startswith('paredis_table_1 at scale ')
    assert told.count('MEMBER') == 5
    assert 'near_axis' in told


@pytest.mark.parametrize(
    ('task', 'options', 'field'),
    [
        (TASK, ['--clearance', '-1'], 'clearance'),
        (TASK, ['--clearance', 'nan'], 'clearance'),
        ('shelf_volumes', [], 'is a volume'),
        ('no_such_task', [], 'no_such_task'),
    ],
)
def test_what_cannot_be_covered_is_refused(task, options, field, tmp_path, capsys):
    output = tmp_path / 'arm.yaml'
    assert main(['template', task, *options, '--output', str(output)]) == 2
    assert field in capsys.readouterr().err
    assert not output.exists()


def test_poses_need_the_template_with_a_wrist(tmp_path, capsys):
    task = tmp_path / 'task.yaml'
    task.write_text(
        'name: t\ngoals:\n  - {position: [0.5, 0.2, 0.3], orientation: [0, 0, 0, 1]}\n'
    )
    assert main(['template', str(task), '--template', 'paredis_table_1']) == 2
    assert 'has no wrist' in capsys.readouterr().err
