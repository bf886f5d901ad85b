#!/usr/bin/env bash
# Compares the public API of the libraries with the packages of the last release, which its tag names: the files that a
# registry has, not those of the repository. Fails if the version promises more than the API keeps.
set -euo pipefail
cd "$(dirname "$0")/.."
tag=$(git describe --tags --abbrev=0 --match 'v*' 2>/dev/null || true)
if [ -z "$tag" ]; then
    echo "semver: no tag of an earlier release, so nothing is compared"
    exit 0
fi
command -v cargo-semver-checks >/dev/null || cargo install cargo-semver-checks --locked
crates=(preshade)
root=$PWD
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

mkdir "$work/source" "$work/.cargo"
git archive "$tag" | tar -x -C "$work/source"
cargo package --quiet --no-verify --manifest-path "$work/source/Cargo.toml" --target-dir "$work/target" \
    "${crates[@]/#/-p}"
for crate in "${crates[@]}"; do
    tar -xzf "$work/target/package/$crate-${tag#v}.crate" -C "$work"
    # The packages need each other, and a registry may not have them.
    printf '[patch.crates-io.%s]\npath = "%s"\n' "$crate" "$work/$crate-${tag#v}" >> "$work/.cargo/config.toml"
done
cd "$work"
# Newer versions of some dependencies need a newer Rust.
export CARGO_RESOLVER_INCOMPATIBLE_RUST_VERSIONS=fallback
for crate in "${crates[@]}"; do
    echo "semver: $crate beside its package of $tag"
    cargo semver-checks --manifest-path "$root/Cargo.toml" -p "$crate" --baseline-root "$work/$crate-${tag#v}"
done
