#!/bin/sh
# Builds preshade.wasm: with rustup's target for WebAssembly if it is installed, else with Debian's compiler, which
# builds the standard library too. `scripts/setup.sh web` installs what is missing.
set -eu
cd "$(dirname "$0")"
target=wasm32-unknown-unknown
export CARGO_TARGET_DIR="${PRESHADE_WEB_TARGET:-$PWD/compiler/target}"
# The file must not name folders of the machine that built it.
registry="${CARGO_HOME:-$HOME/.cargo}/registry/src"
root=$(cd ../.. && pwd)
export CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS="--remap-path-prefix=$registry=crates --remap-path-prefix=$root=preshade"
began=$(date +%s)
if rustup target list --installed 2>/dev/null | grep -q "^$target$"; then
    cargo build --manifest-path compiler/Cargo.toml --release --locked --target $target
else
    # Found by its path: rustup's compiler comes first in PATH.
    export RUSTC=/usr/bin/rustc RUSTDOC=/usr/bin/rustdoc
    # `-Zbuild-std` is not stable.
    export RUSTC_BOOTSTRAP=1
    linker=$(command -v wasm-ld || ls /usr/bin/wasm-ld-* 2>/dev/null | sort -V | tail -1)
    export CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER="$linker"
    /usr/bin/cargo build --manifest-path compiler/Cargo.toml --release --locked --target $target \
        -Zbuild-std=std,panic_abort -Zbuild-std-features=optimize_for_size
fi
cp "$CARGO_TARGET_DIR/$target/release/preshade_web.wasm" preshade.wasm
echo "built preshade.wasm in $(($(date +%s) - began)) s"
node tests/size.mjs
