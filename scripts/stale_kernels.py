"""Remove compiled kernels that call something whose source has changed since.

Numba renews the compiled code of a function when the function's own file changes, but not when a
compiled function that it calls, in another file, does: that one has been built into it.
"""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / 'ft_manip_ros'


def imported(path: Path) -> set[Path]:
    """Return the files of the package that a file imports from."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f'{node.module}.{alias.name}' for alias in node.names)]
        for name in names:
            file = ROOT / (name.replace('.', '/') + '.py')
            if name.startswith(PACKAGE.name) and file.is_file():
                found.add(file)
    return found


def remove_stale() -> int:
    """Remove stale compiled code; returns the number of functions it was of."""
    direct = {path: imported(path) for path in PACKAGE.rglob('*.py')}
    removed = 0
    for path in direct:
        needed, left = {path}, [path]
        while left:
            new = direct.get(left.pop(), set()) - needed
            needed |= new
            left += new
        changed = max(file.stat().st_mtime for file in needed)
        for index in (path.parent / '__pycache__').glob(f'{path.stem}.*.nbi'):
            files = [index, *index.parent.glob(f'{index.name.removesuffix("nbi")}*.nbc')]
            if min(file.stat().st_mtime for file in files) < changed:
                for file in files:
                    file.unlink(missing_ok=True)
                removed += 1
    return removed
