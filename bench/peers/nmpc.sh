#!/bin/sh
# Solves one stream of optimal control problems with acados (https://docs.acados.org), CasADi + IPOPT
# (https://web.casadi.org) and alula, on one core, and prints one table of times, errors and costs.
#
#   bench/peers/nmpc.sh [WORKDIR] [-- options of nmpc/compare.py, for instance --seeds 5]
#
# Needs Rust, Python 3 with venv, a C compiler with make, and access to PyPI on the first run. WORKDIR keeps
# the Python environment, the generated code, problems.csv, solves.csv, summary.json and table.md;
# without it everything goes to a temporary folder and only the table remains.
# README.md says what the figures mean.
set -eu
root=$(CDPATH= cd -- "$(dirname -- "$0")/../.." && pwd)
if [ $# -gt 0 ] && [ "$1" != "--" ]; then
    mkdir -p "$1"
    work=$(CDPATH= cd -- "$1" && pwd)
    shift
else
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
fi
if [ "${1:-}" = "--" ]; then
    shift
fi
venv=$work/venv

if [ ! -e "$venv/ready" ]; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet casadi==3.8.2 comma-deps-acados==0.2.2.post92 numpy
    touch "$venv/ready"
fi
cargo build --quiet --release --manifest-path "$root/Cargo.toml" -p alula-planning --example peer_problem
target=${CARGO_TARGET_DIR:-$root/target}

# acados' generated code looks for its libraries here; nothing may start threads of its own.
libraries=$("$venv/bin/python" -c 'import acados; print(acados.LIB_DIR)')
LD_LIBRARY_PATH=$libraries${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
OMP_NUM_THREADS=1
PYTHONDONTWRITEBYTECODE=1
export LD_LIBRARY_PATH OMP_NUM_THREADS PYTHONDONTWRITEBYTECODE
"$venv/bin/python" "$root/bench/peers/nmpc/compare.py" \
    --alula "$target/release/examples/peer_problem" --work "$work" "$@"
