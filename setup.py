"""ament_python package: executables under lib/ft_manip_ros, config and launch under share."""

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'ft_manip_ros'
NODES = ('arm_sim', 'fault_monitor', 'replanner', 'workspace', 'designer', 'recorder', 'demo')


def share_tree(folder: str) -> list[tuple[str, list[str]]]:
    """Install every configuration file below `folder` under the same path of the share folder."""
    folders: dict[str, list[str]] = {}
    for path in sorted(Path(folder).rglob('*')):
        if path.suffix in ('.yaml', '.urdf', '.json', '.rviz'):
            folders.setdefault(f'share/{NAME}/{path.parent}', []).append(str(path))
    return list(folders.items())


setup(
    name=NAME,
    version='0.1.0',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/launch', sorted(glob('launch/*.launch.py'))),
        *share_tree('config'),
        ('bin', ['scripts/ftmanip']),
    ],
    install_requires=['setuptools'],
    # colcon runs pytest only where it finds it here; setuptools ignores tests_require.
    extras_require={'test': ['pytest']},
    zip_safe=True,
    author='ft_manip_ros maintainers',
    maintainer='ft_manip_ros maintainers',
    maintainer_email='maintainers@ft-manip.example',
    description='Fault-tolerant manipulators on ROS 2: design, fault detection, re-planning.',
    license='Apache-2.0',
    python_requires='>=3.10',
    entry_points={
        'console_scripts': [
            *(f'{name} = {NAME}.nodes.{name}:main' for name in NODES),
            f'ftmanip = {NAME}.cli.main:main',
        ],
    },
)
