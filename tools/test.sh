#!/bin/sh
# Sets up .venv and runs the tests; arguments go to pytest: sh tools/test.sh tests/rigs -x
. "$(dirname -- "$0")/_setup.sh"

exec .venv/bin/python -m pytest "$@"
