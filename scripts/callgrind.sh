#!/usr/bin/env bash
# Counts the instructions of each step of the compiler, in millions, by callgrind. Unlike times, counts vary
# by only a fraction of a percent on a busy machine.
# The factor after each count compares it with the size before. Counts exclude the parsing that a step needs.
# Usage: scripts/callgrind.sh [EXPRESSIONS..]
set -euo pipefail
cd "$(dirname "$0")/.."
sizes=("$@")
[ ${#sizes[@]} -gt 0 ] || sizes=(100 1000 10000)
command -v valgrind >/dev/null || { echo "error: valgrind is not installed" >&2; exit 2; }

binary=$(cargo bench -p preshade --bench growth --no-run --message-format=json 2>/dev/null |
  sed -n 's/.*"executable":"\([^"]*growth-[^"]*\)".*/\1/p' | tail -1)
counts=$(mktemp)
trap 'rm -f "$counts"' EXIT

instructions() {
  valgrind --tool=callgrind --callgrind-out-file=/dev/null "$binary" --only "$@" 2>"$counts" >/dev/null
  awk '/Collected :/ { print $4 }' "$counts"
}

declare -A reading
printf '%-20s' step
for shape in one many; do for size in "${sizes[@]}"; do printf '%18s' "$shape $size"; done; done
printf '\n'
for step in naga read graph depth-prepass early-discard shadow hoist visibility-buffer wgsl; do
  printf '%-20s' "$step"
  for shape in one many; do
    before=
    for size in "${sizes[@]}"; do
      count=$(instructions "$step" "$shape" "$size")
      case $step in
        naga) ;;
        read) reading[$shape$size]=$count ;;
        *) count=$((count - ${reading[$shape$size]})) ;;
      esac
      printf '%18s' "$(awk -v n="$count" -v b="$before" 'BEGIN { printf "%.1f%s", n / 1e6, b ? sprintf(" x%.1f", n / b) : "" }')"
      before=$count
    done
  done
  printf '\n'
done
