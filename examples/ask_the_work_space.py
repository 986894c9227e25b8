"""Ask whether points are fault tolerant for an arm, what loses them, and which limits keep them.

python examples/ask_the_work_space.py
"""

from pathlib import Path

import numpy as np

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.ftws.operating_limits import find_operating_limits
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings

HERE = Path(__file__).parent


def main() -> None:
    """Ask about three points, then for limits under which the lost one is kept."""
    arm = load_arm(HERE / 'inspection_arm.yaml')
    points = np.array([[0.5, 0.1, 0.3], [0.9, 0.0, 0.4], [1.6, 0.0, 0.2]])
    for answer in query(arm, points, settings=FtwsSettings(margin=True), threads=2):
        print(f'{answer.point}: {answer.verdict.value}')
        if answer.joints:
            angle = np.rad2deg(answer.angles[0])
            print(f'    {answer.joints[0]} locked at {angle:.1f} deg misses it by', end=' ')
            print(f'{answer.residual * 1e3:.1f} mm or more')
        else:
            print(f'    and so is all within {answer.margin * 1e3:.1f} mm of it')
        for joint, share in answer.surviving_fraction.items():
            if share < 1.0:
                print(f'    {joint} may lock at {share:.0%} of its angles')
    # A joint can only lock where it may be: narrower operating limits, more tolerance.
    found = find_operating_limits(arm, points)
    print(found.reason)
    for joint, interval in found.limits.items():
        if interval is not None:
            low, high = np.rad2deg(interval)
            print(f'    {joint}: {low:.1f} to {high:.1f} deg')


if __name__ == '__main__':
    main()
