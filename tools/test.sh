#!/bin/sh
# Sets up .venv and runs the tests; arguments go to pytest: sh tools/test.sh tests/rigs -x
. "$(dirname -- "$0")/_setup.sh"

# The tests of HTML pages need a browser and are skipped without one.
if ! find_browser >/dev/null; then
    if can_install; then
        say "installing a browser for the tests of HTML pages"
        install_packages chromium || say "no browser: the tests of HTML pages are skipped"
    else
        say "no browser: the tests of HTML pages are skipped; to run them, install chromium"
    fi
fi

# Tests start many processes: what one compiled serves the others.
unset PYTHONDONTWRITEBYTECODE
# Two files of tests at a time; threads that wait leave the cores to the others. -n 0 undoes it.
export OMP_WAIT_POLICY="${OMP_WAIT_POLICY:-passive}"
export PYTEST_ADDOPTS="-n 2 --dist loadfile --no-loadscope-reorder ${PYTEST_ADDOPTS-}"
exec .venv/bin/python -m pytest "$@"
