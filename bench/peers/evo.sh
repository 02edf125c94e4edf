#!/bin/sh
# Compares alula's trajectory metrics with those of the `evo` tool (https://github.com/MichaelGrupp/evo)
# on three pairs of trajectories; ends 0 only if no figure differs by more than 1e-6.
#
# Needs Rust, Python 3 with venv, and access to PyPI on the first run. EVO_VENV names a folder for
# the Python environment that outlives the run; without it everything goes to a temporary folder.
# With ALULA_DATA set, the first pair comes from the real EuRoC recording in it.
set -eu
root=$(CDPATH= cd -- "$(dirname -- "$0")/../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
venv=${EVO_VENV:-$work/venv}

if [ ! -x "$venv/bin/evo_ape" ]; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet 'evo>=1.30'
fi
cargo build --quiet --release --manifest-path "$root/Cargo.toml" -p alula-estimation --example metrics
target=${CARGO_TARGET_DIR:-$root/target}

# evo keeps settings in the home folder of whoever runs it; give it one of its own.
HOME=$work "$venv/bin/python" "$root/bench/peers/evo_compare.py" \
    --metrics "$target/release/examples/metrics" --work "$work"
