"""Maps: rigorous bounds, look-ups without false answers, files, interruption."""

import json

import numpy as np
import pytest

from ft_manip_ros.cli.main import main
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.ftws_map import load_map
from ft_manip_ros.core.ftws.map_build import build_map
from ft_manip_ros.core.ftws.map_frame import map_frame
from ft_manip_ros.core.ftws.map_query import query_with_map
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.templates import VOLUME
from ft_manip_ros.core.ftws.verdict import Verdict
from unit.ftws.arms import planar, table_1, table_1_distance


@pytest.fixture(scope='module')
def revolution():
    arm = table_1()
    frame = map_frame(arm, 'rz')
    return build_map(arm, frame, low=[0.0, -2.5], high=[2.5, 2.5], depth=6, threads=2)


def test_the_volume_of_table_1_is_between_the_bounds(revolution):
    lower, upper = revolution.measure()
    assert lower < VOLUME < upper
    assert upper - lower < 0.35 * VOLUME
    assert revolution.complete


def test_lookups_are_never_wrong(revolution):
    rng = np.random.default_rng(9)
    points = rng.uniform(-1.7, 1.7, (3000, 3))
    inside = table_1_distance(points) <= 0.0
    answers = [revolution.lookup(point) for point in points]
    for answer, member in zip(answers, inside, strict=True):
        assert answer is not (Verdict.NON_MEMBER if member else Verdict.MEMBER)
    assert answers.count(Verdict.UNDECIDED) < 0.15 * len(points)
    assert revolution.lookup([9.0, 0.0, 0.0]) is Verdict.UNDECIDED


def test_files_give_the_map_back(revolution, tmp_path):
    revolution.save(tmp_path / 'map.npz')
    again = load_map(tmp_path / 'map.npz')
    assert again.measure() == revolution.measure()
    member = again.cells()[0][int(np.argmax(again.grid.ravel() == 1))]
    assert again.lookup(member) is revolution.lookup(member) is Verdict.MEMBER
    revolution.save(tmp_path / 'map.csv')
    lines = (tmp_path / 'map.csv').read_text().splitlines()
    assert len(lines) == 1 + revolution.grid.size
    with pytest.raises(InputError):
        revolution.save(tmp_path / 'map.txt')
    (tmp_path / 'broken.npz').write_bytes(b'not a map')
    with pytest.raises(InputError):
        load_map(tmp_path / 'broken.npz')


def test_planar_slice_bounds_the_disc():
    arm = planar(1.0, 1.0, 1.0, 1.0)
    disc = build_map(arm, map_frame(arm, 'xy'), low=[-2.5, -2.5], high=[2.5, 2.5], depth=5)
    lower, upper = disc.measure()
    assert lower < 4.0 * np.pi < upper
    assert disc.lookup([0.5, 0.5, 0.1]) is Verdict.UNDECIDED  # off the slice
    off = build_map(arm, map_frame(arm, 'xy', at=0.5), depth=3)
    assert off.measure()[0] == 0.0


def test_interruption_leaves_a_right_but_coarse_map():
    arm = planar(1.0, 1.0, 1.0, 1.0)
    frame = map_frame(arm, 'xy')
    calls = []

    def interrupt(done, total):
        calls.append(done)
        if len(calls) == 3:
            raise KeyboardInterrupt

    part = build_map(arm, frame, low=[0, 0], high=[2.5, 2.5], depth=7, progress=interrupt)
    assert not part.complete
    lower, upper = part.measure()
    assert lower <= np.pi <= upper


def test_maps_do_not_depend_on_the_number_of_threads():
    arm = planar(1.0, 0.8, 0.7)
    maps = [build_map(arm, map_frame(arm, 'xy'), depth=5, threads=n).grid for n in (1, 2)]
    assert (maps[0] == maps[1]).all()


def test_command_line_map(tmp_path, capsys):
    picture, file = tmp_path / 'map.png', tmp_path / 'map.npz'
    command = ['ftws', 'planar_4r', '--grid', 'xy', '--depth', '4', '--json']
    assert main([*command, '--plot', str(picture), '--map', str(file)]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer['lower'] < 4.0 * np.pi < answer['upper']
    assert picture.stat().st_size > 1000
    assert load_map(file).arm


def test_a_map_answers_what_it_knows_and_the_engine_the_rest(revolution):
    arm = table_1()
    points = np.array([[0.7, 0.3, 0.2], [1.9, 0.0, 2.3], [1.999, 0.0, 0.1], [0.5, 0.5, 2.6]])
    known = [revolution.lookup(point) for point in points]
    assert known == [
        Verdict.MEMBER, Verdict.NON_MEMBER, Verdict.UNDECIDED, Verdict.UNDECIDED,
    ]  # fmt: skip
    results = query_with_map(revolution, arm, points)
    assert [result.point for result in results] == [tuple(point) for point in points.tolist()]
    # The third is near the boundary, the last outside the map: both are for the engine.
    assert [result.verdict for result in results] == [
        Verdict.MEMBER, Verdict.NON_MEMBER, Verdict.MEMBER, Verdict.NON_MEMBER,
    ]  # fmt: skip
    assert ['cell of the map' in result.reason for result in results] == [True, True, False, False]
    assert results[3].joints


def test_a_map_answers_for_its_own_arm_and_tolerance_alone(revolution, tmp_path):
    points = np.zeros((1, 3))
    narrower = table_1(limit_deg=179.0)
    with pytest.raises(InputError, match='not of'):
        query_with_map(revolution, narrower, points)
    with pytest.raises(InputError, match='made for 1e-06'):
        query_with_map(revolution, table_1(), points, settings=FtwsSettings(tolerance=1e-4))
    revolution.save(tmp_path / 'map.npz')
    assert load_map(tmp_path / 'map.npz', table_1()).fingerprint == revolution.fingerprint
    with pytest.raises(InputError, match=r'map\.npz: is a map of'):
        load_map(tmp_path / 'map.npz', narrower)


def test_command_line_lookup(tmp_path, capsys):
    file = str(tmp_path / 'map.npz')
    assert main(['ftws', 'planar_4r', '--grid', 'xy', '--depth', '4', '--map', file]) == 0
    capsys.readouterr()
    ask = ['ftws', 'planar_4r', '--lookup', file, '--json', '--point', '1', '0.4', '0']
    assert main(ask) == 0
    assert json.loads(capsys.readouterr().out)['verdict'] == 'member'
    for wrong, field in (
        (['--order', '2'], '--order'),
        (['--margin'], '--lookup'),
        (['--tolerance', '1e-3'], 'tolerance'),
    ):
        assert main([*ask, *wrong]) == 2
        assert field in capsys.readouterr().err
    assert main(['ftws', 'planar_5r', *ask[2:]]) == 2
    assert 'planar_5r' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('kind', 'options', 'field'),
    [
        ('xy', {'low': [0.0], 'high': [1.0]}, 'bounds'),
        ('xy', {'low': [1.0, 0.0], 'high': [0.0, 1.0]}, 'bounds'),
        ('rz', {'low': [-1.0, 0.0], 'high': [1.0, 1.0]}, 'bounds'),
        ('xy', {'depth': 40}, 'depth'),
    ],
)
def test_malformed_maps_name_the_field(kind, options, field):
    arm = table_1()
    with pytest.raises(InputError) as error:
        build_map(arm, map_frame(arm, kind), **options)
    assert error.value.field == field


def test_revolution_needs_a_first_joint_that_turns():
    with pytest.raises(InputError):
        map_frame(table_1(limit_deg=170.0), 'rz')
