#!/bin/sh
# Sets everything up in .venv and passes the tests: lint, format, types, pytest. Arguments go to pytest.
# --sanitize, in the first place: only the tests that call kernels (or those named), with scripts/sanitized.sh.
set -eu
cd "$(dirname "$0")/.."
. scripts/environment.sh
# else each of forty processes compiles 600 files anew, 0.2 s
unset PYTHONDONTWRITEBYTECODE
make_environment "[gl,dev]"
if [ "${1:-}" = --sanitize ]; then
    shift
    # a fault ends the process: what it says must not wait in what pytest has caught
    # shellcheck disable=SC2046
    [ $# -gt 0 ] || set -- $(grep -lE "^(from|import) tracker\.(kernels|_native)" tests/test_*.py)
    OPENBLAS_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1 exec scripts/sanitized.sh .venv/bin/python -m pytest -n auto --dist loadfile --capture=sys "$@"
fi
# pyrender pins PyOpenGL 3.1.0, which fails on Python 3.12 and with OSMesa.
.venv/bin/python -m pip install --quiet --disable-pip-version-check --upgrade "PyOpenGL>=3.1.10" 2>/dev/null

gl_packages="libegl1 libgl1 libxrender1 libosmesa6"
if ! ldconfig -p 2>/dev/null | grep -q libOSMesa; then
    say "installing the OpenGL packages that the renderer tests use: $gl_packages"
    # shellcheck disable=SC2086
    apt_install $gl_packages || say "not installed; tests that need them say so (apt-get install $gl_packages)"
fi
[ -n "${BODYTRACK_DATA:-}" ] || say "BODYTRACK_DATA is not set: tests on recordings are skipped"

say "ruff"
.venv/bin/ruff check .
.venv/bin/ruff format --check .

say "mypy, beside the tests"
.venv/bin/mypy tracker scripts >.venv/mypy.log 2>&1 &
mypy=$!

# files in the order of their names: the last ones are quick, so that no worker waits a minute for the other
say "pytest"
status=0
OPENBLAS_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1 .venv/bin/python -m pytest -n auto --dist loadfile --no-loadscope-reorder "$@" || status=$?
wait "$mypy" || status=1
cat .venv/mypy.log
exit "$status"
