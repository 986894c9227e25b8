#!/usr/bin/env bash
# Set up everything that running, testing and linting need: `.venv` and `install`.
#
# Safe to run at any time, also twice at once. What is up to date is left alone, so a second run
# takes a moment; each part carries a key (.venv/setup.key, install/*.key) that is removed before
# the part is touched and written when it is whole, so an interrupted run is noticed and redone.
#
# PYTHON=... chooses the interpreter for a new .venv.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
venv=$root/.venv
print_version='import sys; print("%d.%d" % sys.version_info[:2])'
logs=$root/log

die() {
    echo "set-up: $*" >&2
    exit 1
}

say() {
    echo "set-up: $*" >&2
}

# One key for everything that makes what $@ names: file names and contents.
key_of() {
    find "$@" -type f ! -name '*.pyc' | LC_ALL=C sort | while read -r file; do
        sha256sum "$file"
    done | sha256sum | cut -c 1-16
}

choose_mode() {
    case "${ROS_DISTRO:-}" in
        '') mode=wheels ;;
        jazzy) mode=ros ;;
        *) die "ROS 2 ${ROS_DISTRO} is sourced, but this package is for ROS 2 Jazzy:" \
            "source that, or none" ;;
    esac
}

# True where $1 runs and is a Python we support (and sees ROS, where ROS is sourced).
usable_python() {
    local code='import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))'
    [ "$mode" = wheels ] || code="import rclpy; $code"
    "$1" -c "$code" >/dev/null 2>&1
}

choose_python() {
    local candidate
    for candidate in ${PYTHON:-python3.12 python3 /usr/bin/python3 python3.13 python3.11 python3.10}
    do
        if usable_python "$candidate"; then
            # pyenv and the like put scripts on PATH: name the interpreter itself.
            python=$("$candidate" -c 'import sys; print(sys.executable)')
            return
        fi
    done
    [ "$mode" = wheels ] || die "ROS 2 is sourced, but no Python here imports rclpy"
    [ -z "${PYTHON:-}" ] || die "PYTHON=$PYTHON does not run or is not Python 3.10 to 3.13"
    die "needs Python 3.10 to 3.13 (python3 is" \
        "$(python3 --version 2>&1 | head -n 1 || true)): install python3.12, or set PYTHON"
}

# Everything that only the system can provide, asked for in one line.
check_tools() {
    local missing=() version
    version=$("$python" -c "$print_version")
    # cmake finds a compiler by these names, or by CXX and CC.
    command -v "${CXX:-c++}" >/dev/null || command -v g++ >/dev/null || command -v clang++ \
        >/dev/null || missing+=(g++)
    command -v "${CC:-cc}" >/dev/null || command -v gcc >/dev/null || command -v clang \
        >/dev/null || missing+=(gcc)
    command -v cmake >/dev/null || missing+=(cmake)
    command -v make >/dev/null || missing+=(make)
    "$python" -c 'import venv, ensurepip' 2>/dev/null || missing+=("python$version-venv")
    "$python" -c 'import os, sys, sysconfig
sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' ||
        missing+=("python$version-dev")
    [ ${#missing[@]} -eq 0 ] || die "missing for $python: ${missing[*]}" \
        "(Debian, Ubuntu: sudo apt install ${missing[*]})"
}

# Run pip and turn what usually goes wrong into one line.
pip_install() {
    local log=$logs/pip.log
    rm -f "$log"
    PYTHONPATH='' "$venv/bin/python" -m pip --disable-pip-version-check --no-input install \
        --no-compile --progress-bar off --log "$log" "$@" >"$logs/pip.out" 2>&1 && return
    if grep -qiE 'name resolution|failed to establish|connection (refused|error|broken|reset)|timed out|ProxyError|SSLError|unreachable|Max retries' \
        "$log"; then
        die "cannot reach the Python package index: check the network or proxy" \
            "(details: $logs/pip.out)"
    fi
    if grep -qi 'No space left' "$logs/pip.out"; then
        die "no space left on the disk that holds $root"
    fi
    die "pip failed: $(grep -m 1 -E '^ *ERROR' "$logs/pip.out" || tail -n 1 "$logs/pip.out")" \
        "(details: $logs/pip.out)"
}

# Whether .venv is whole, of this kind and of this checkout; sets `version` to its Python's.
reusable_venv() {
    [ -e "$venv/setup.key" ] || return 1
    local its_mode its_root
    read -r its_mode version _ its_root <"$venv/setup.key"
    [ "$its_mode" = "$mode" ] && [ "$its_root" = "$root" ] || return 1
    "$venv/bin/python" -c '' 2>/dev/null || return 1
    [ -z "${PYTHON:-}" ] || [ "$("$PYTHON" -c "$print_version" 2>/dev/null)" = "$version" ]
}

make_venv() {
    local key version
    if [ "$mode" = ros ]; then
        key=$(key_of requirements/ros.lock scripts/missing_requirements.py)
    else
        key=$(key_of requirements/requirements.lock)
    fi
    if reusable_venv; then
        [ "$(cat "$venv/setup.key")" != "$mode $version $key $root" ] || return 0
        say "bringing .venv up to date"
        rm "$venv/setup.key"
    else
        choose_python
        check_tools
        version=$("$python" -c "$print_version")
        say "making .venv with Python $version ($mode); a minute or two"
        rm -rf "$venv" "$root/build" "$root/install"
        local system=()
        [ "$mode" = wheels ] || system=(--system-site-packages)
        "$python" -m venv "${system[@]}" "$venv" >&2 || die "cannot make $venv"
    fi
    mkdir -p "$logs"
    # colcon must not look for packages in here.
    touch "$venv/COLCON_IGNORE"
    if [ "$mode" = ros ]; then
        # Only what this ROS installation lacks: never a second numpy or Pinocchio.
        "$venv/bin/python" scripts/missing_requirements.py >"$logs/missing.txt"
        pip_install --no-deps -r "$logs/missing.txt"
    else
        pip_install --no-deps -r requirements/requirements.lock
        cat >"$venv/colcon_defaults.yaml" <<YAML
build:
  symlink-install: true
  cmake-args:
    - -DCMAKE_PROJECT_INCLUDE=$root/scripts/wheel_includes.cmake
    - -DPython3_EXECUTABLE=$venv/bin/python
    - -DBUILD_TESTING=OFF
    - --no-warn-unused-cli
YAML
    fi
    write_key "$venv/setup.key" "$mode $version $key $root"
}

write_key() {
    echo "$2" >"$1.new"
    sync -f "$1.new" 2>/dev/null || true
    mv "$1.new" "$1"
}

# Build package $1 (whose key is $2) with colcon, unless it is built as it stands. With a third
# argument what an earlier build left is kept.
build_package() {
    local package=$1 key=$2
    local file=$root/install/$package.key
    [ "$(cat "$file" 2>/dev/null)" != "$key" ] || return 0
    say "building $package"
    rm -f "$file"
    [ -n "${3:-}" ] || rm -rf "$root/build/$package" "$root/install/$package"
    mkdir -p "$logs" "$root/install"
    (
        # Not what an outer make says about its own jobs, and however busy the machine is.
        unset MAKELEVEL MFLAGS
        MAKEFLAGS=-j$(nproc)
        export MAKEFLAGS
        if [ "$mode" = wheels ]; then
            export AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv PYTHONPATH=''
            export COLCON_DEFAULTS_FILE=$venv/colcon_defaults.yaml
        fi
        export PATH=$venv/bin:$PATH
        "$venv/bin/python" -m colcon --log-base "$logs" build --symlink-install \
            --base-paths . ft_manip_interfaces --packages-select "$package" \
            --event-handlers console_direct-
    ) >"$logs/build_$package.out" 2>&1 || die "building $package failed:" \
        "$(grep -m 1 -iE 'error' "$logs/build_$package.out" || echo 'see the log')" \
        "(details: $logs/build_$package.out)"
    write_key "$file" "$key"
}

case "$root" in
    *[[:space:]]*) die "the path of this checkout has a space in it, which ROS does not survive" ;;
esac
command -v flock >/dev/null || die "missing: util-linux (the command flock)"
exec 9>"$root/.setup.lock"
if ! flock -n 9; then
    say "waiting for another set-up of this checkout"
    flock 9
fi
choose_mode
make_venv
# What is built depends on the interpreter and the place, not on each package beside it.
read -r _ version _ <"$venv/setup.key"
venv_key="$mode $version $root"
build_package ft_manip_interfaces "$(key_of ft_manip_interfaces) $venv_key"
build_package ft_manip_ros \
    "$(key_of setup.py setup.cfg package.xml resource scripts/ftmanip) $(
        find config launch -type f | LC_ALL=C sort | sha256sum | cut -c 1-16) $venv_key" keep
# Links to files that are gone.
find "$root/install/ft_manip_ros" -xtype l -delete
