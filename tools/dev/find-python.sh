#!/bin/sh
# Prints the first Python on PATH that is new enough and can make virtual environments; `find-python.sh PYTHON` looks
# only at PYTHON. Written for sh because no Python is sure to be there.
set -eu

seen=
[ $# -gt 0 ] || set -- python3 python3.14 python3.13 python3.12 python3.11 python
for python in "$@"; do
    command -v "$python" > /dev/null 2>&1 || continue
    version=$("$python" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])' 2> /dev/null) || continue
    if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
        seen="$seen $python is $version;"
    elif ! "$python" -c 'import venv, ensurepip' 2> /dev/null; then
        seen="$seen $python is $version but lacks venv (Debian: apt-get install python3-venv);"
    else
        command -v "$python"
        exit 0
    fi
done
echo "make: wanted Python 3.11 or newer with venv, found:${seen:- none.} Install one, or name it: make setup PYTHON=/path/to/python3" >&2
exit 1
