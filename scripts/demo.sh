#!/bin/sh
# Sets everything up in .venv and runs the demo: simulate, bootstrap, track, compare with the truth.
set -eu
cd "$(dirname "$0")/.."
. scripts/environment.sh
make_environment ""
exec .venv/bin/bodytrack demo "$@"
