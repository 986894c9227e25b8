"""The `ftmanip` command itself: help without imports, exit codes, every command present."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

from ft_manip_ros.cli.main import COMMANDS, main


def test_help_lists_every_command_and_loads_none(capsys):
    code = 'import sys; from ft_manip_ros.cli.main import main; main(["--help"]);'
    code += 'assert not [m for m in sys.modules if m.startswith(("numba", "rclpy", "mcap"))]'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    for name in COMMANDS:
        assert f'\n  {name} ' in done.stdout


def test_matplotlib_is_loaded_for_pictures_only():
    modules = [c.module for name, c in COMMANDS.items() if name != 'report']
    code = (
        'import importlib, sys\n'
        f'for module in {modules}:\n'
        '    importlib.import_module("ft_manip_ros.cli." + module)\n'
        '    assert "matplotlib" not in sys.modules, module\n'
    )
    subprocess.run([sys.executable, '-c', code], check=True)


@pytest.mark.parametrize('name', COMMANDS)
def test_every_command_is_there_and_explains_itself(name, capsys):
    module = importlib.import_module(f'ft_manip_ros.cli.{COMMANDS[name].module}')
    assert callable(module.run)
    with pytest.raises(SystemExit) as stop:
        main([name, '--help'])
    assert stop.value.code == 0
    assert f'ftmanip {name}' in capsys.readouterr().out


def test_wrong_usage_is_2_and_says_what_there_is(capsys):
    assert main([]) == 2
    assert 'usage' in capsys.readouterr().err
    assert main(['fly']) == 2
    assert 'tolerance' in capsys.readouterr().err
    with pytest.raises(SystemExit) as stop:
        main(['query', '--order'])
    assert stop.value.code == 2


def test_bad_input_is_2_and_names_the_field(capsys):
    assert main(['ftws', 'no_such_arm', '--point', '0', '0', '0']) == 2
    said = capsys.readouterr().err
    assert said.startswith('ftmanip ftws: ')
    assert 'no_such_arm' in said


def test_a_reader_that_leaves_is_no_error():
    code = 'import sys; from ft_manip_ros.cli.main import main;'
    code += 'sys.exit(main(["ftws", "planar_4r"] + ["--json", "--point"] + ["1", "0", "0"] * 400))'
    process = subprocess.Popen(
        [sys.executable, '-c', code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.readline()
    process.stdout.close()
    assert process.stderr is not None
    said = process.stderr.read()
    assert process.wait(60) == 0
    assert 'Traceback' not in said
