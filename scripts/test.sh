#!/usr/bin/env bash
# All tests, in two halves at once: what draws waits for its adapter, and what is drawn in a browser for that, a third of the time. The second half is printed when the first has ended.
set -uo pipefail
cd "$(dirname "$0")/.."
of() { cargo test --workspace --all-features --no-fail-fast "$@"; }

of --no-run || exit
said=$(mktemp)
trap 'rm -f "$said"' EXIT
of --test '[p-z]*' >"$said" 2>&1 &
second=$!
trap 'kill $second; exit 130' INT TERM
failed=0
of --lib --bins --test '[a-o]*' || failed=1
# Tests of documentation alone, by their names: `--doc` would have cargo build all libraries once more, for other features of what the command line's tests need.
of --quiet -- '(line ' || failed=1
wait $second || failed=1
cat "$said"
exit $failed
