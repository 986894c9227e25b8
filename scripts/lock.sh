#!/usr/bin/env bash
# Write requirements/requirements.lock (machines without ROS) and requirements/ros.lock (Ubuntu
# 24.04 with ROS 2 Jazzy) from requirements/*.in. Needs `uv` on PATH.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../requirements"

compile() {
    uv pip compile --quiet --no-header --no-emit-index-url --generate-hashes "$@"
}

compile --universal --python-version 3.10 runtime.in build.in test.in -o requirements.lock

# ROS brings its own packages, and Ubuntu its numpy. Pinocchio's wheels ask for a newer one in
# their metadata only: they run with this one.
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat ./*.in | grep -vE '^(#|ros-|setuptools|wheel)' >"$work/all.in"
grep -vE '^(pin|example-robot-data)\b' "$work/all.in" >"$work/plain.in"
grep -E '^(pin|example-robot-data)\b' "$work/all.in" >"$work/pinocchio.in"
for_noble=(--python-version 3.12 --python-platform linux --no-annotate)
compile "${for_noble[@]}" -c noble.txt "$work/plain.in" -o "$work/plain.lock"
compile "${for_noble[@]}" --override noble.txt --no-emit-package numpy "$work/pinocchio.in" \
    -o "$work/pinocchio.lock"
grep -v '^# ' "$work/plain.lock" "$work/pinocchio.lock" --no-filename >ros.lock
