#!/usr/bin/env bash
# Run the tests: those given in arguments for pytest, or all of them. Most use one core each and run
# two at a time; nodes have the machine for themselves, for they have to answer in time.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if [ $# -gt 0 ]; then
    exec python3 -m pytest "$@"
fi
side_by_side=(test/unit test/property test/replay)
failed=0
python3 -m pytest -n 2 "${side_by_side[@]}" || failed=1
python3 -m pytest "${side_by_side[@]/#/--ignore=}" || failed=1
exit "$failed"
