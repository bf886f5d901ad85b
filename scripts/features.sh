#!/bin/sh
# Checks the library with each of its features alone, with none and with the default, and its unit tests with the default: what a user turns off must not be missed.
set -eu
cd "$(dirname "$0")/.."
lint() { cargo clippy -p preshade --quiet "$@" -- -D warnings; }
lint --lib --no-default-features
for feature in compiler glsl naga-oil wesl spirv verify; do
    lint --lib --no-default-features --features "$feature"
done
lint --lib --tests
