"""The `ftmanip` command: one sub-command a module, imported only when it is used."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ft_manip_ros.core.errors import InputError


@dataclass(frozen=True)
class Command:
    """A sub-command: where its `add_parser(subparsers)` and `run(args) -> int` are."""

    module: str
    help: str


COMMANDS = {
    'ftws': Command('ftws_command', 'judge points: are they in the fault-tolerant work space?'),
    'verify': Command('verify_command', 'check verdicts and their proofs again'),
    'limits': Command('limits_command', 'find operating limits that keep points fault tolerant'),
    'query': Command('query_command', 'ask the running workspace node about points'),
    'design': Command('design_command', 'design an arm that reaches a task whatever joint locks'),
    'tolerance': Command('tolerance_command', 'which failures, and when, a task survives'),
    'detect': Command('detect_command', 'run the fault monitor over recorded joint data'),
    'replay': Command('replay_command', 're-run a bag and compare with what it recorded'),
    'bag': Command('bag_command', 'look into a bag, repair it, convert it'),
    'report': Command('report_command', 'write a report of a bag'),
}


class _Help(argparse.Action):
    """List the commands without importing any of them."""

    def __init__(self, option_strings: Sequence[str], dest: str, **_: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, help='show this help and exit')

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        print('usage: ftmanip COMMAND ... (ftmanip COMMAND --help says more)\n')
        for name, command in COMMANDS.items():
            print(f'  {name:<10} {command.help}')
        print('\nExit codes: 0 answered, 1 a check failed, 2 bad usage or bad input.')
        parser.exit(0)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one sub-command.

    Returns
    -------
    int
        0 answered, 1 a check failed, 2 bad usage or bad input.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    parser = argparse.ArgumentParser(prog='ftmanip', add_help=False)
    parser.add_argument('-h', '--help', action=_Help)
    if not arguments or arguments[0] not in COMMANDS:
        if not arguments or arguments[0] in ('-h', '--help'):
            parser.parse_args(['--help'])
        parser.exit(2, f'ftmanip: no command {arguments[0]!r}; there are {", ".join(COMMANDS)}\n')
    subparsers = parser.add_subparsers(dest='command', required=True)
    module = importlib.import_module(f'ft_manip_ros.cli.{COMMANDS[arguments[0]].module}')
    module.add_parser(subparsers)
    try:
        return int(module.run(parser.parse_args(arguments)))
    except InputError as error:
        print(f'ftmanip {arguments[0]}: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # Whoever read the output (head, less) has gone; the interpreter must not flush into it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


if __name__ == '__main__':
    sys.exit(main())
