#!/bin/sh
# Checks the workspace with the oldest compiler that Cargo.toml promises.
set -eu
cd "$(dirname "$0")/.."
version=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
case "$(rustc --version)" in
    "rustc $version"*) cargo check --workspace --all-features --all-targets ;;
    *) rustup run "$version" cargo check --workspace --all-features --all-targets ;;
esac
