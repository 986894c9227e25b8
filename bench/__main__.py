"""Run the benchmarks: ``python -m bench [NAME ...]``.

A benchmark is a module ``bench/bench_<name>.py`` with a function ``run()`` that prints its
tables. Each runs in a process of its own, so that one cannot warm up, slow down or bring down
another; what it prints is also kept under ``out/bench``.
"""

from __future__ import annotations

import argparse
import importlib
import os
import platform
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

FOLDER = Path(__file__).parent
PREFIX = 'bench_'


def names() -> list[str]:
    """Return the name of every benchmark, sorted."""
    return sorted(path.stem.removeprefix(PREFIX) for path in FOLDER.glob(f'{PREFIX}*.py'))


def machine() -> str:
    """Return one line that says what the figures were measured on."""
    model = platform.machine()
    info = Path('/proc/cpuinfo')
    if info.exists():
        lines = [line for line in info.read_text().splitlines() if line.startswith('model name')]
        model = lines[0].partition(':')[2].strip() if lines else model
    packages = ', '.join(f'{name} {version(name)}' for name in ('numpy', 'numba', 'scipy'))
    return f'{model}, {os.cpu_count()} CPUs, Python {platform.python_version()}, {packages}'


def run_apart(name: str, output: Path) -> bool:
    """Run one benchmark in a process of its own, on the terminal and into a file."""
    print(f'\n== {name} ==', flush=True)
    start = time.monotonic()
    with (
        output.open('w') as kept,
        subprocess.Popen(
            [sys.executable, '-u', '-m', 'bench', '--here', name],
            cwd=FOLDER.parent,
            stdout=subprocess.PIPE,
            text=True,
        ) as process,
    ):
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end='', flush=True)
            kept.write(line)
    ended = 'done' if process.returncode == 0 else f'FAILED with exit code {process.returncode}'
    print(f'-- {name}: {ended} after {time.monotonic() - start:.0f} s', flush=True)
    return process.returncode == 0


def main() -> int:
    """Run the benchmarks named on the command line, or all of them."""
    parser = argparse.ArgumentParser(prog='python -m bench', description='Run the benchmarks.')
    parser.add_argument('names', nargs='*', metavar='NAME', help=', '.join(names()))
    parser.add_argument('--here', action='store_true', help='run in this process')
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.names) - set(names()))
    if unknown:
        parser.error(f'no benchmark {", ".join(unknown)}; there are: {", ".join(names())}')
    chosen = arguments.names or names()
    if arguments.here:
        for name in chosen:
            importlib.import_module(f'bench.{PREFIX}{name}').run()
        return 0
    folder = FOLDER.parent / 'out' / 'bench'
    folder.mkdir(parents=True, exist_ok=True)
    print(machine())
    results = [run_apart(name, folder / f'{name}.txt') for name in chosen]
    return 0 if all(results) else 1


if __name__ == '__main__':
    sys.exit(main())
