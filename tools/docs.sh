#!/bin/sh
# Sets up .venv, builds the site offline into out/site, and checks it; runs the examples that changed.
# sh tools/docs.sh --fresh forgets earlier builds and runs all examples.
extras=dev,docs
. "$(dirname -- "$0")/_setup.sh"

if [ "${1-}" = --fresh ]; then
    rm -rf out/docs out/site
fi

say "== copy the pages and list the API"
export PYTHONPATH="$root/docs"
.venv/bin/python -m _site.stage

say "== run the examples and write the site; a warning is an error"
.venv/bin/python -m sphinx -b html -q -W --keep-going -c docs -d out/docs/doctrees out/docs/source out/site

say "== the examples took"
.venv/bin/python -m _site.examples

say "== check links, anchors and pictures, and open the main pages in a browser"
TOMO_SITE="$root/out/site" .venv/bin/python -m pytest -n 0 tests/tomo/test_site.py

say "done; open out/site/index.html"
