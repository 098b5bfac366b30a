# Sourced by demo.sh and test.sh: finds Python, makes .venv, installs the package.
# usage: . scripts/environment.sh; make_environment "[extras]"

say() { printf '%s\n' "$*" >&2; }
fail() { say "error: $*"; exit 2; }

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"
    elif command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; then sudo -n "$@"
    else return 1
    fi
}

apt_install() {
    command -v apt-get >/dev/null 2>&1 || return 1
    as_root apt-get update -qq >/dev/null 2>&1 || return 1
    DEBIAN_FRONTEND=noninteractive as_root apt-get install -y -qq --no-install-recommends "$@" >/dev/null 2>&1
}

find_python() {
    for candidate in python3.13 python3.12 python3.11 python3 python; do
        if command -v "$candidate" >/dev/null 2>&1 &&
            "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
    fail "no Python 3.11 or newer found; install one, e.g. apt-get install python3 (Debian 12, Ubuntu 24.04 or newer)"
}

# The package has a part in C++ (native/), which pip builds.
find_compiler() {
    command -v "${CXX:-c++}" >/dev/null 2>&1 && return
    say "installing g++, which the package is built with"
    apt_install g++ libc6-dev || fail "no C++ compiler found: apt-get install g++ (Debian, Ubuntu), xcode-select --install (macOS)"
}

make_environment() {
    python=$(find_python) || exit 2
    find_compiler
    if [ ! -x .venv/bin/python ] || ! .venv/bin/python -m pip --version >/dev/null 2>&1; then
        say "making .venv with $python"
        rm -rf .venv
        if ! "$python" -m venv .venv >/dev/null 2>&1; then
            say "installing python3-venv, which this Python lacks"
            apt_install python3-venv || fail "Python cannot make virtual environments: apt-get install python3-venv"
            rm -rf .venv
            "$python" -m venv .venv || fail "$python -m venv .venv failed"
        fi
    fi
    say "installing bodytrack$1 into .venv (the first time takes a minute or two)"
    # 50 s of CPU to compile all that comes; what is imported is compiled then, and kept, unless Python is told not to
    compile=--no-compile
    [ -z "${PYTHONDONTWRITEBYTECODE:-}" ] || compile=--compile
    .venv/bin/python -m pip install --quiet --disable-pip-version-check "$compile" -e ".$1" ||
        fail "pip could not install the package; is the package index reachable?"
}
