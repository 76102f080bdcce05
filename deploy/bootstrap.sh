#!/bin/sh
# Makes the virtual environment and installs this project with pinned versions, or returns at once if that was done.
#
# PARTS            run: what one assembly in the simulated cell needs; all, the default: everything, with what the tests
#                  need, and torch for the trained networks. An environment that has all keeps it
# PYTHON           the interpreter to use; default: the first of python3, python3.11, python3.10 for which PyBullet has
#                  ready-made wheels (3.10 and 3.11 on Linux, x86_64); else the first of python3, python3.13, python3.12,
#                  python3.14 ... that is new enough, and MuJoCo simulates the cell
# VENV             where the environment is made; default: .venv
# TORCH_INDEX_URL  an additional package index that has torch's CPU build
# TORCH            any: where no index has torch's CPU build, install the default one, with gigabytes of CUDA; without it
#                  torch is left out there, and with it what uses trained networks
set -eu

root=$(cd "$(dirname "$0")/.." && pwd -P)
cd "$root"
VENV=${VENV:-.venv}
PYTHON=${PYTHON:-}
TORCH_INDEX_URL=${TORCH_INDEX_URL:-}
TORCH=${TORCH:-}
PARTS=${PARTS:-all}
stamp="$VENV/.crosspih-stamp"
log="$VENV/install.log"
left_out="$VENV/.crosspih-without-torch"
has="$VENV/.crosspih-parts"

fail() {
    printf 'crosspih: %s\n' "$*" >&2
    exit 1
}

say() {
    printf 'crosspih: %s\n' "$*" >&2
}

new_enough() {
    "$1" -c 'import sys; sys.exit(sys.version_info < (3, 10))' >/dev/null 2>&1
}

# PyBullet has wheels for these only; elsewhere it would have to be compiled.
has_all_wheels() {
    "$1" -c 'import platform, sys, venv, ensurepip
sys.exit((sys.platform, platform.machine()) != ("linux", "x86_64") or not (3, 10) <= sys.version_info[:2] < (3, 12))' \
        >/dev/null 2>&1
}

version_of() {
    "$1" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])' 2>/dev/null || echo unknown
}

# What is installed depends on these files.
fingerprint() {
    cat pyproject.toml deploy/constraints.txt deploy/bootstrap.sh | cksum
}

# An environment can be used again if it was made in this folder (it holds the folder's name), its interpreter is still
# there, and no other one is asked for.
usable() {
    [ -f "$VENV/.crosspih-root" ] && [ "$(cat "$VENV/.crosspih-root")" = "$root" ] && new_enough "$VENV/bin/python" &&
        { [ -z "$PYTHON" ] || [ "$(version_of "$PYTHON")" = "$(version_of "$VENV/bin/python")" ]; }
}

case $PARTS in
    run | all) ;;
    *) fail "PARTS=$PARTS: want run or all" ;;
esac
if usable && [ -f "$has" ] && [ "$(cat "$has")" = all ]; then
    PARTS=all
fi

if usable && [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$(fingerprint)" ] && [ "$(cat "$has")" = "$PARTS" ] &&
    { [ ! -f "$left_out" ] || [ -z "$TORCH$TORCH_INDEX_URL" ]; }; then
    exit 0
fi

case $TORCH in
    '' | any) ;;
    *) fail "TORCH=$TORCH: want any, or nothing" ;;
esac

if [ -n "$PYTHON" ]; then
    command -v "$PYTHON" >/dev/null 2>&1 || fail "no Python at PYTHON=$PYTHON; name one that is 3.10 or newer"
    new_enough "$PYTHON" || fail "PYTHON=$PYTHON is Python $(version_of "$PYTHON"); 3.10 or newer is needed"
    python=$PYTHON
else
    python='' found=''
    for candidate in python3 python3.11 python3.10; do
        if command -v "$candidate" >/dev/null 2>&1 && has_all_wheels "$candidate"; then
            python=$candidate found=$candidate
            break
        fi
    done
    for candidate in python3 python3.13 python3.12 python3.14 python3.11 python3.10; do
        [ -z "$python" ] || break
        command -v "$candidate" >/dev/null 2>&1 || continue
        found=${found:-$candidate}
        if new_enough "$candidate"; then
            python=$candidate
        fi
    done
    [ -n "$found" ] || fail "no Python found; install Python 3.10 or newer, or name it with PYTHON=/path/to/python3"
    [ -n "$python" ] ||
        fail "$found is Python $(version_of "$found"); install 3.10 or newer, or name one with PYTHON=/path/to/python3"
fi
"$python" -c 'import venv, ensurepip' >/dev/null 2>&1 ||
    fail "$python has no venv module; install it (Debian and Ubuntu: apt install python3-venv)"

# Never remove a folder that is not an environment.
if [ -e "$VENV" ] && [ ! -f "$VENV/pyvenv.cfg" ] && [ -n "$(ls -A "$VENV" 2>/dev/null)" ]; then
    fail "VENV=$VENV exists and is no virtual environment; name another folder"
fi
started=$(date +%s)
if usable; then
    say "bringing $VENV up to date"
    rm -f "$stamp"
else
    say "making $VENV with Python $(version_of "$python"); the first time takes some minutes"
    "$python" -m venv --clear "$VENV" >/dev/null 2>&1 || fail "cannot make $VENV: $python -m venv --clear $VENV fails"
    printf '%s\n' "$root" >"$VENV/.crosspih-root"
fi
: >"$log"

# Installs "$@"; the whole of what pip says is in the log.
install() {
    "$VENV/bin/python" -m pip install --quiet --no-input --disable-pip-version-check --retries 2 \
        --constraint deploy/constraints.txt ${TORCH_INDEX_URL:+--extra-index-url "$TORCH_INDEX_URL"} "$@" \
        >>"$log" 2>&1
}

install_or_fail() {
    install "$@" && return
    if grep -q -i -E 'NewConnectionError|NameResolutionError|name resolution|Name or service not known|nodename nor|Network is unreachable|Connection refused|ConnectTimeout|ReadTimeout|timed out|ProxyError|No route to host' "$log"; then
        fail "no network: pip reached no package index; connect, or point PIP_INDEX_URL at a mirror (all it said: $log)"
    fi
    reason=$(grep -i '^error' "$log" | tail -n 1)
    fail "pip could not install: ${reason:-see $log} (all it said: $log)"
}

install_or_fail setuptools

# On Linux the index's plain torch carries several gigabytes of CUDA libraries, which nothing here uses. The CPU build
# of the same release is taken wherever the configured indexes have it. Elsewhere torch is left out: an assembly does not
# need it, only the trained networks do, and nobody who types `make assemble` expects gigabytes.
rm -f "$left_out"
if [ "$PARTS" = run ]; then
    extra=run
else
    extra=all,dev
fi
if [ "$PARTS" = all ] && [ "$(uname -s)" = Linux ] && [ "$TORCH" != any ]; then
    torch=$(sed -n 's/^torch==\([0-9.]*\).*/\1/p' deploy/constraints.txt)
    if ! install --no-deps "torch==$torch+cpu"; then
        [ -z "$TORCH_INDEX_URL" ] || fail "no CPU build of torch $torch at TORCH_INDEX_URL=$TORCH_INDEX_URL (see $log)"
        extra=torchless,dev
    fi
fi

install_or_fail --no-build-isolation --editable ".[$extra]"
# the headers of the C++ libraries that came with it, 190 MB: for compilers, which nothing here uses
rm -rf "$VENV"/lib/python3.*/site-packages/cmeel.prefix/include
if [ "$extra" = run ]; then
    say "this is what an assembly needs; make env adds torch for the trained networks (strategies paper," \
        "network_spiral and sequence, crosspih train), tables, DXF, certificates and what the tests need"
elif [ "$extra" = torchless,dev ]; then
    : >"$left_out"
    say "torch is left out: no CPU build at the configured package indexes; what uses trained networks wants" \
        "make env TORCH_INDEX_URL=(PyTorch's CPU index), or TORCH=any for the default build with gigabytes of CUDA"
fi
"$VENV/bin/python" -c 'import pybullet' >/dev/null 2>&1 ||
    say "MuJoCo simulates the cell: there is no ready-made PyBullet for Python $(version_of "$VENV/bin/python") here"
printf '%s\n' "$PARTS" >"$has"
fingerprint >"$stamp"
say "$VENV is ready ($(($(date +%s) - started)) s)"
