#!/bin/sh
# Checks the library with no feature, with each feature alone and with the default, and its unit tests with the
# default: no code may need a feature that a user turned off.
set -eu
cd "$(dirname "$0")/.."
lint() { cargo clippy --quiet "$@" -- -D warnings; }
lint -p preshade --lib --no-default-features
for feature in compiler glsl naga-oil wesl spirv verify; do
    lint -p preshade --lib --no-default-features --features "$feature"
done
lint -p preshade-compiler --lib
for feature in glsl naga-oil wesl spirv; do
    lint -p preshade-compiler --lib --features "$feature"
done
lint -p preshade-frames --lib
