#!/usr/bin/env bash
# Runs all tests. Those that draw run beside the others: drawing waits for the adapter and leaves a core free.
# The output of the tests that draw is printed when the others have ended.
set -uo pipefail
cd "$(dirname "$0")/.."
tests() { cargo test --workspace --all-features --no-fail-fast "$@"; }

tests --no-run || exit
drawn=$(mktemp)
trap 'rm -f "$drawn"' EXIT
tests --test gpu --test stability >"$drawn" 2>&1 &
drawing=$!
trap 'kill $drawing; exit 130' INT TERM
failed=0
tests --lib --bins --test it --test tools || failed=1
# Doc tests, selected by their names: `--doc` would build all libraries again with other features.
tests --quiet -- '(line ' || failed=1
wait $drawing || failed=1
cat "$drawn"
exit $failed
