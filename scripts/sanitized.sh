#!/bin/sh
# Runs a command with the extension built for debugging, with g++'s address and undefined-behaviour sanitizers: the first
# fault of the kernels ends the process, and is told with its line. The usual build in tracker/ stays as it is.
# usage: scripts/sanitized.sh .venv/bin/python -m pytest tests/test_native.py
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
python=$1
case $python in *python*) ;; *) echo "usage: scripts/sanitized.sh PYTHON ARGUMENTS" >&2; exit 2 ;; esac
"$python" "$root/native/build.py" --sanitize
for library in libasan.so libubsan.so libstdc++.so; do
    # Python itself is built without: the sanitizers must be there before it loads anything
    LD_PRELOAD="${LD_PRELOAD:+$LD_PRELOAD:}$("${CXX:-g++}" -print-file-name=$library)"
done
# Python leaves memory to the system when it ends, and other extensions mix new with free
ASAN_OPTIONS="detect_leaks=0:alloc_dealloc_mismatch=0:$(printf %s "${ASAN_OPTIONS:-}")"
UBSAN_OPTIONS="print_stacktrace=1:${UBSAN_OPTIONS:-}"
PYTHONPATH="$root/native/sanitized:${PYTHONPATH:-$root}"
export LD_PRELOAD ASAN_OPTIONS UBSAN_OPTIONS PYTHONPATH
exec "$@"
