"""The `ftmanip` command: one sub-command a module, imported only when it is used."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass

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
    'template': Command('template_command', "scale one of the paper's template arms to a task"),
    'tolerance': Command('tolerance_command', 'which failures, and when, a task survives'),
    'detect': Command('detect_command', 'run the fault monitor over recorded joint data'),
    'replay': Command('replay_command', 're-run a bag and compare with what it recorded'),
    'bag': Command('bag_command', 'look into a bag, repair it, convert it'),
    'report': Command('report_command', 'write a report of a bag'),
}


def overview() -> str:
    """List the commands, without importing any of them."""
    lines = ['usage: ftmanip COMMAND ... (ftmanip COMMAND --help says more)', '']
    lines += [f'  {name:<10} {command.help}' for name, command in COMMANDS.items()]
    return '\n'.join(
        [*lines, '', 'Exit codes: 0 answered, 1 a check failed, 2 bad usage or input.']
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run one sub-command.

    Returns
    -------
    int
        0 answered, 1 a check failed, 2 bad usage or bad input.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    if not arguments:
        print(overview(), file=sys.stderr)
        return 2
    if arguments[0] in ('-h', '--help'):
        print(overview())
        return 0
    if arguments[0] not in COMMANDS:
        known = ', '.join(COMMANDS)
        print(f'ftmanip: no command {arguments[0]!r}; there are {known}', file=sys.stderr)
        return 2
    parser = argparse.ArgumentParser(prog='ftmanip')
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
