#!/usr/bin/env bash
# Lists every crate that a program is built of, with its licence, as CycloneDX: sbom.sh MANIFEST TARGET OUT
set -euo pipefail
cd "$(dirname "$0")/.."
manifest=${1:?MANIFEST is missing} target=${2:?TARGET is missing} out=${3:?OUT is missing}
command -v cargo-cyclonedx >/dev/null || cargo install cargo-cyclonedx --locked --quiet

# It writes a file of this name beside each manifest of the workspace.
name=sbom-$$
trap 'git ls-files -oz "*$name.json" | xargs -0 rm -f' EXIT
cargo cyclonedx --quiet --manifest-path "$manifest" --format json --spec-version 1.5 --target "$target" \
    --override-filename "$name"
# Our own crates are named by their folder on this machine.
sed "s|$PWD|/preshade|g" "$(dirname "$manifest")/$name.json" > "$out"
