# Source this file (sh, bash or zsh) for a shell in which `ros2 run ft_manip_ros ...` and `ftmanip`
# work:  . ./env.sh
# It uses the ROS 2 Jazzy that is sourced already, if there is one, and `.venv` + `install`, which
# `make setup` builds. Sourcing it twice changes nothing.

# Where this file is. dash does not say, but keeps the sourced file open.
_ftm_locate() {
    if [ -n "${BASH_VERSION:-}" ]; then
        # shellcheck disable=SC3028,SC3054
        _ftm_file=$BASH_SOURCE
    elif [ -n "${ZSH_VERSION:-}" ]; then
        eval '_ftm_file=${(%):-%x}'
    else
        _ftm_file=./env.sh
        for _ftm_fd in /proc/$$/fd/*; do
            case "$(readlink "$_ftm_fd" 2>/dev/null)" in
                */env.sh) _ftm_file=$(readlink "$_ftm_fd") ;;
            esac
        done
        unset _ftm_fd
    fi
    FT_MANIP_ROOT=$(CDPATH='' cd -- "$(dirname -- "$_ftm_file")" && pwd)
}

# Print path list $1 with $2 in front, once.
_ftm_prepend() {
    case ":$1:" in
        *":$2:"*) printf '%s' "$1" ;;
        *) printf '%s' "$2${1:+:$1}" ;;
    esac
}

_ftm_enter() {
    if [ ! -e "$FT_MANIP_ROOT/.venv/setup.key" ]; then
        echo "env.sh: $FT_MANIP_ROOT is not set up yet: run 'make setup' there first" >&2
        return 1
    fi
    _ftm_mode=$(cut -d ' ' -f 1 "$FT_MANIP_ROOT/.venv/setup.key")
    _ftm_python=$(cut -d ' ' -f 2 "$FT_MANIP_ROOT/.venv/setup.key")
    if [ "$_ftm_mode" = ros ] && [ -z "${ROS_DISTRO:-}" ]; then
        echo "env.sh: set up for a ROS installation: source it first, or run 'make setup'" >&2
        return 1
    fi
    if [ "$_ftm_mode" = wheels ] && [ -n "${ROS_DISTRO:-}" ]; then
        echo "env.sh: set up without ROS, but ROS is sourced here: run 'make setup' again" >&2
        return 1
    fi

    _ftm_install=$FT_MANIP_ROOT/install
    AMENT_PREFIX_PATH=${AMENT_PREFIX_PATH:-}
    if [ "$_ftm_mode" = wheels ]; then
        AMENT_PREFIX_PATH=$(_ftm_prepend "$AMENT_PREFIX_PATH" "$FT_MANIP_ROOT/.venv")
        CMAKE_PREFIX_PATH=$(_ftm_prepend "${CMAKE_PREFIX_PATH:-}" "$FT_MANIP_ROOT/.venv")
        # The wheels bring this middleware and no other.
        RMW_IMPLEMENTATION=rmw_fastrtps_cpp
        COLCON_DEFAULTS_FILE=$FT_MANIP_ROOT/.venv/colcon_defaults.yaml
        export CMAKE_PREFIX_PATH RMW_IMPLEMENTATION COLCON_DEFAULTS_FILE
    fi
    for _ftm_package in ft_manip_interfaces ft_manip_ros; do
        _ftm_prefix=$_ftm_install/$_ftm_package
        AMENT_PREFIX_PATH=$(_ftm_prepend "$AMENT_PREFIX_PATH" "$_ftm_prefix")
        PYTHONPATH=$(_ftm_prepend "${PYTHONPATH:-}" \
            "$_ftm_prefix/lib/python$_ftm_python/site-packages")
    done
    PYTHONPATH=$(_ftm_prepend "$PYTHONPATH" "$FT_MANIP_ROOT/build/ft_manip_ros")
    LD_LIBRARY_PATH=$(_ftm_prepend "${LD_LIBRARY_PATH:-}" "$_ftm_install/ft_manip_interfaces/lib")
    PATH=$(_ftm_prepend "$PATH" "$FT_MANIP_ROOT/.venv/bin")
    PATH=$(_ftm_prepend "$PATH" "$_ftm_install/ft_manip_ros/bin")
    command -v ros2 >/dev/null 2>&1 || PATH=$PATH:$FT_MANIP_ROOT/scripts/standin
    # Talk on this machine only, unless you decided otherwise.
    ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}
    export FT_MANIP_ROOT AMENT_PREFIX_PATH PYTHONPATH LD_LIBRARY_PATH PATH
    export ROS_AUTOMATIC_DISCOVERY_RANGE
}

_ftm_locate
_ftm_enter
_ftm_status=$?
unset _ftm_file _ftm_mode _ftm_python _ftm_install _ftm_package _ftm_prefix
unset -f _ftm_locate _ftm_prepend _ftm_enter
# `return` hands the verdict to the caller and leaves no variable behind.
[ "$_ftm_status" -eq 0 ] && unset _ftm_status || { unset _ftm_status; return 1; }
