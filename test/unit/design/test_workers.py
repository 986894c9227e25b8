"""Threads, processes and a Dask cluster do the same; a killed worker costs only time."""

import threading
import time

import numpy as np
import psutil
import pytest

from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import DesignSpec
from ft_manip_ros.core.task_file import load_task

TASK = load_task('paredis_eq_11')
# Out of reach with one of three joints locked, so that every segment is done.
HOPELESS = DesignSpec(3, 1, -2.6, 2.6)


def outcome(result):
    table = result.table
    return (
        result.proved,
        result.penalty,
        result.iterations,
        result.evaluations,
        *table.d,
        *table.a,
        *table.alpha,
    )


def search(segments=10, **settings):
    return outcome(design_arm(TASK, HOPELESS, DesignSettings(max_segments=segments, **settings)))


@pytest.mark.parametrize('method', ['worst_cases', 'annealing'])
def test_processes_do_what_threads_do(method):
    one = search(method=method, angles=9)
    assert search(method=method, angles=9, workers=3) == one
    assert search(method=method, angles=9, workers=2, executor='processes') == one


def test_a_killed_process_costs_time_not_the_search():
    expected = search(segments=60)
    killed = []

    def kill_one():
        mine = psutil.Process()
        while not killed:
            for child in mine.children(recursive=True):
                # Among the children only the workers have been busy.
                if child.status() != 'zombie' and child.cpu_times().user > 1.0:
                    killed.append(child.pid)
                    child.kill()
                    return
            time.sleep(0.01)

    thread = threading.Thread(target=kill_one, daemon=True)
    thread.start()
    found = search(segments=60, workers=2, executor='processes')
    thread.join(5.0)
    assert killed
    assert found == expected


def test_a_dask_cluster_does_what_threads_do_and_survives_a_killed_worker():
    # The locked requirements bring it; a machine with packages of rosdep alone may lack it.
    distributed = pytest.importorskip('distributed')
    expected = search(segments=24)
    # Processes of their own, each looked after by a nanny that starts a killed one anew.
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        victims = {nanny.pid for nanny in cluster.workers.values()}
        killed = []

        def kill_one(*_):
            if not killed:
                killed.append(victims.pop())
                psutil.Process(killed[0]).kill()

        result = design_arm(
            TASK,
            HOPELESS,
            DesignSettings(max_segments=24, workers=2, scheduler=address, time_budget=300.0),
            on_candidate=kill_one,
        )
    assert killed
    assert outcome(result) == expected


def test_a_scheduler_that_does_not_answer_is_named():
    pytest.importorskip('distributed')
    with pytest.raises(InputError, match='scheduler'):
        search(scheduler='not an address')


def test_stopping_processes_keeps_what_they_have():
    seen = []
    result = design_arm(
        TASK,
        HOPELESS,
        DesignSettings(workers=2, executor='processes', time_budget=280.0),
        on_candidate=lambda *candidate: seen.append(candidate),
        should_stop=lambda: bool(seen),
    )
    assert seen
    assert not result.proved
    assert np.isfinite(result.penalty)
    assert 'request' in result.reason
