"""Write docs/parameters.md from the nodes' own declarations; ``--check`` only compares."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

from ft_manip_ros.nodes.parameters import AUTOSTART, ParameterSpec

PAGE = Path(__file__).parent.parent / 'docs' / 'parameters.md'
MODULES = {
    'arm_sim': 'arm_sim',
    'designer': 'design_parameters',
    'fault_monitor': 'fault_parameters',
    'recorder': 'recorder',
    'replanner': 'replanner',
    'workspace': 'workspace',
}
HEAD = """\
# Parameters

Of every node, as `ros2 param describe` shows them. Defaults are also in `config/NODE.yaml`, to copy and to pass with `--params-file` (there the fault monitor also keeps a state file). A value out of range is refused with a message; most parameters are read when the node configures, *fixed* ones only when its process starts. This page is written by `scripts/document_parameters.py`.
"""  # noqa: E501


def row(spec: ParameterSpec) -> str:
    """Return one parameter as a line of a table."""
    allowed = ''
    if spec.choices:
        allowed = ', '.join(f'`{choice}`' for choice in spec.choices)
    elif spec.lower is not None and spec.upper is not None:
        allowed = f'{spec.lower:g} to {spec.upper:g}'
    default = spec.default
    shown = getattr(default, 'name', None) or repr(default).lower().replace("'", '"')
    if isinstance(default, str):
        shown = f'"{default}"'
    elif default is not None and hasattr(default, 'name'):
        shown = f'[] ({default.name.lower().replace("_", " ")})'
    fixed = ' *Fixed.*' if spec.read_only else ''
    meaning = spec.description.replace('|', '\\|')
    return f'| `{spec.name}` | `{shown}` | {spec.unit} | {allowed} | {meaning}{fixed} |'


def page() -> str:
    """Return the whole page."""
    parts = [HEAD]
    for node, module in MODULES.items():
        specs = importlib.import_module(f'ft_manip_ros.nodes.{module}').PARAMETERS
        parts.append(f'\n## {node}\n\n| name | default | unit | allowed | meaning |\n')
        parts.append('|---|---|---|---|---|\n')
        parts += [f'{row(spec)}\n' for spec in (*specs, AUTOSTART)]
    return ''.join(parts)


def main() -> int:
    """Write the page, or compare it with what is there."""
    if '--check' in sys.argv[1:]:
        if PAGE.exists() and PAGE.read_text() == page():
            return 0
        print(f'{PAGE} is out of date: run scripts/document_parameters.py', file=sys.stderr)
        return 1
    PAGE.write_text(page())
    return 0


if __name__ == '__main__':
    sys.exit(main())
