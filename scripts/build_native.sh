#!/bin/sh
# Builds the extension tracker._native into tracker/ of this checkout: after a change of native/, and once in a new worktree.
# usage: scripts/build_native.sh; PYTHON=... chooses the Python, otherwise that of .venv, of the environment in use, or python3
set -eu
cd "$(dirname "$0")/.."
python=${PYTHON:-}
[ -n "$python" ] || { [ -x .venv/bin/python ] && python=.venv/bin/python; } || python=${VIRTUAL_ENV:+$VIRTUAL_ENV/bin/python}
exec "${python:-python3}" native/build.py
