#!/bin/sh
# Judges every scenario and every test of this repository; the status is 0 only if all passed.
PATH="$PWD/vibrohil/.venv/bin:$PATH"
mkdir -p artefacts
status=0
vibrohil suite scenarios/*.toml --out artefacts/suite || status=$?
pytest tests --junitxml artefacts/tests.xml || { tests=$?; [ "$status" -ne 0 ] || status=$tests; }
exit "$status"
