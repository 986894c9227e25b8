#!/usr/bin/env python3
"""Record the library of cases again: the real nodes, each case in processes of its own.

Usage: . ./env.sh; python bags/regenerate.py [CASE ...]      (without names: all of them)
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import yaml
from cases import CASES, Case

from ft_manip_ros.bags.expected import expected_of
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.replay import replay

HERE = Path(__file__).resolve().parent


def regenerate(case: Case) -> None:
    """Record one case, replay it, and write down what the replay found."""
    from story import record

    with tempfile.TemporaryDirectory() as scratch:
        bag = Path(scratch) / 'bag'
        if case.truncate is None:
            record(case, bag, Path(scratch) / 'logs')
        else:
            shutil.copytree(HERE / case.truncate / 'bag', bag)
            (bag / 'metadata.yaml').unlink()
            file = next(bag.glob('*.mcap'))
            file.write_bytes(file.read_bytes()[: int(file.stat().st_size * 0.6)])
        opened = open_bag(bag)
        result = replay(opened)
        for difference in result.differences:
            old, new = difference.recorded, difference.replayed
            print(f'  differs: {old and old.text()} | {new and new.text()}')
        folder = HERE / case.name
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(bag, folder / 'bag')
        content = yaml.safe_dump(expected_of(result, opened.start), sort_keys=False)
        (folder / 'expected.yaml').write_text(content, encoding='utf-8')
        (folder / 'README.md').write_text(f'{case.shows}\n', encoding='utf-8')
        for finding in result.replayed:
            print(f'  {finding.kind} {finding.text()}')


def main() -> int:
    """Regenerate the named cases; 2 for a name that is none."""
    names = sys.argv[1:] or list(CASES)
    unknown = [name for name in names if name not in CASES]
    if unknown:
        print(f'no case {", ".join(unknown)}; there are {", ".join(CASES)}', file=sys.stderr)
        return 2
    for name in names:
        print(name)
        regenerate(CASES[name])
    return 0


if __name__ == '__main__':
    sys.exit(main())
