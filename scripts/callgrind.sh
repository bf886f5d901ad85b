#!/usr/bin/env bash
# Instructions of each step of the compiler, counted by callgrind: unlike times they are the same on a busy machine, to a fraction of a percent.
# Usage: scripts/callgrind.sh [EXPRESSIONS..]
set -euo pipefail
cd "$(dirname "$0")/.."
sizes=("$@")
[ ${#sizes[@]} -gt 0 ] || sizes=(100 1000 10000)
command -v valgrind >/dev/null || { echo "error: valgrind is not installed" >&2; exit 2; }

# The newest of the bench's binaries is the one that was just built.
cargo bench -p preshade --bench growth --no-run 2>/dev/null
binary=$(ls -t target/release/deps/growth-* | grep -v '\.d$' | head -1)
counts=$(mktemp)
trap 'rm -f "$counts"' EXIT

# All steps but `naga` count the reading that they need before them.
instructions() {
  valgrind --tool=callgrind --callgrind-out-file=/dev/null "$binary" --only "$@" 2>"$counts" >/dev/null
  awk '/Collected :/ { print $4 }' "$counts"
}

printf '%-20s' step
for shape in one many; do for size in "${sizes[@]}"; do printf '%16s' "$shape $size"; done; done
printf '\n'
for step in naga read graph depth-prepass early-discard shadow hoist visibility-buffer wgsl; do
  printf '%-20s' "$step"
  for shape in one many; do
    for size in "${sizes[@]}"; do printf '%16s' "$(instructions "$step" "$shape" "$size")"; done
  done
  printf '\n'
done
