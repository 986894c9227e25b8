"""`ftmanip ftws`: the contract of its output, its files and its errors."""

import json

import pytest

from ft_manip_ros.cli.main import main
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.point_file import read_points


def test_json_lines_carry_the_contract_in_input_order(tmp_path, capsys):
    file = tmp_path / 'points.csv'
    file.write_text('x,y,z\n1.0,0.2,0.0\n\n2.5,0,0\n')
    command = ['ftws', 'planar_4r', '--point', '0.5', '0.5', '0', '--points', str(file), '--json']
    assert main(command) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row['point'] for row in rows] == [[0.5, 0.5, 0.0], [1.0, 0.2, 0.0], [2.5, 0.0, 0.0]]
    assert [row['verdict'] for row in rows] == ['member', 'member', 'non_member']
    for row in rows:
        assert {'joints', 'angles', 'residual', 'tolerated', 'surviving_fraction'} <= set(row)
        assert row['elapsed_s'] > 0.0
    lost = rows[2]
    assert lost['joints'] == ['joint_1'] and len(lost['angles']) == 1
    # Closed form: joint 1 frozen the other way leaves a reach of 3 - 1.
    assert 0.0 < lost['residual'] <= 0.5 + 1e-9
    assert set(lost['tolerated']) == {f'joint_{i}' for i in range(1, 5)}
    assert lost['surviving_fraction']['joint_1'] < 1.0


def test_the_text_names_joint_and_angle(capsys):
    assert main(['ftws', 'planar_4r', '--point', '2.5', '0', '0', '--margin']) == 0
    text = capsys.readouterr().out
    assert 'NON_MEMBER' in text and 'joint_1 at' in text and 'tolerated' in text


@pytest.mark.parametrize(
    'arguments',
    [
        ['planar_4r'],
        ['planar_4r', '--point', '1', '2'],
        ['planar_4r', '--point', '1', 'nan', '2'],
        ['planar_4r', '--point', '1', '0', '0', '--order', '9'],
        ['planar_4r', '--point', '1', '0', '0', '--mode', 'pose'],
        ['planar_4r', '--point', '1', '0', '0', '--tolerance', '0'],
        ['no_such_arm', '--point', '1', '0', '0'],
        ['planar_4r', '--plot', 'out.png'],
        ['planar_4r', '--grid', 'xy', '--bounds', '0', '1'],
        ['planar_4r', '--points', '/does/not/exist.csv'],
    ],
)
def test_bad_input_exits_with_2_and_says_what(arguments, capsys):
    assert main(['ftws', *arguments]) == 2
    assert capsys.readouterr().err.startswith('ftmanip ftws: ')


@pytest.mark.parametrize(
    ('text', 'where'),
    [
        ('1,2\n', ':1'),
        ('x,y,z\n1,2,3\n1,2,three\n', ':3'),
        ('1,2,inf\n', ':1'),
        ('1,2,3\n1,2,3,0,0,0,1\n', ':2'),
        ('x,y,z\n', ''),
    ],
)
def test_malformed_csv_names_the_line(tmp_path, text, where):
    file = tmp_path / 'points.csv'
    file.write_text(text)
    with pytest.raises(InputError) as error:
        read_points(file)
    assert error.value.field == f'{file}{where}'


def test_poses_are_read_with_their_header(tmp_path):
    file = tmp_path / 'poses.csv'
    file.write_text('x,y,z,qx,qy,qz,qw\n1,0.5,0,0,0,0,1\n')
    assert read_points(file) == [[1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0]]
