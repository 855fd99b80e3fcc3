#!/bin/sh
# Sets up .venv and runs the tests; arguments go to pytest: sh tools/test.sh tests/rigs -x
. "$(dirname -- "$0")/_setup.sh"

# Two files of tests at a time; threads that wait leave the cores to the others. -n 0 undoes it.
export OMP_WAIT_POLICY="${OMP_WAIT_POLICY:-passive}"
export PYTEST_ADDOPTS="-n 2 --dist loadfile --no-loadscope-reorder ${PYTEST_ADDOPTS-}"
exec .venv/bin/python -m pytest "$@"
