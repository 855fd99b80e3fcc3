# Sourced by demo.sh, test.sh and docs.sh: goes to the project's root, sees that Python, the system
# libraries and .venv are there, and says what is missing. Quick when nothing changed.
# A script that needs more than the extra `dev` sets extras before: extras=dev,docs
# shellcheck shell=sh
set -eu

say() { printf '%s\n' "$*" >&2; }
stop() {
    say "error: $*"
    exit 2
}

extras=${extras:-dev}
root=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
cd "$root"

can_install() {
    [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1
}

install_packages() {
    say "installing: $*"
    { apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -q -y "$@"; } >&2
}

# Install Debian or Ubuntu packages as root, or print the line that would.
need_packages() {
    if can_install; then
        install_packages "$@" || stop "apt-get could not install: $*"
    elif command -v apt-get >/dev/null 2>&1; then
        stop "missing on this system: $*; run: sudo apt-get install -y $*"
    else
        stop "missing on this system: $* (Debian's names); install them with its package manager"
    fi
}

find_browser() {
    for browser in chromium chromium-browser google-chrome google-chrome-stable; do
        command -v "$browser" && return
    done
    return 1
}

find_python() {
    for candidate in ${PYTHON:-} python3.11 python3.12 python3.13 python3 python; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$candidate"
            return
        fi
    done
    stop "found no Python 3.11 or newer; on Debian or Ubuntu run:" \
        "sudo apt-get install -y python3 python3-venv (or set PYTHON to one)"
}

make_environment() {
    if [ -x .venv/bin/python ] && .venv/bin/python -c 'import pip' 2>/dev/null; then
        return
    fi
    python=$(find_python)
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
        need_packages "python$version-venv"
    fi
    say "making .venv with $python"
    "$python" -m venv --clear .venv
}

# The stamp names what was installed from, and the extras, so that only who needs more pays for more;
# it is written last, so a broken install is redone.
install_dependencies() {
    stamp=.venv/installed-from
    now="$root $(cat setup.cfg pyproject.toml constraints.txt | cksum)"
    if [ -f "$stamp" ]; then
        case "$(cat "$stamp")" in
            "$now $extras" | "$now $extras",*) return ;;
        esac
    fi
    say "installing the dependencies into .venv (some minutes the first time)"
    rm -f "$stamp"
    .venv/bin/python -m pip install -q -c constraints.txt -e ".[$extras]" >&2 ||
        stop "pip could not install the dependencies: its own message is above"
    printf '%s\n' "$now $extras" >"$stamp"
}

# Open3D's shared libraries, each with the Debian package that holds it.
check_system_libraries() {
    [ "$(uname -s)" = Linux ] || return 0
    missing=$(.venv/bin/python -c '
import ctypes
libraries = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
}
for library, package in libraries.items():
    try:
        ctypes.CDLL(library)
    except OSError:
        print(package)
')
    # shellcheck disable=SC2086
    [ -z "$missing" ] || need_packages $missing
}

make_environment
check_system_libraries
install_dependencies
