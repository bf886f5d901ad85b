#!/bin/sh
# Builds preshade.wasm and preshade-full.wasm, and the standard library with them: with rustup's compiler if its
# component rust-src is installed, else with Debian's. `scripts/setup.sh web` installs what is missing.
set -eu
cd "$(dirname "$0")"
target=wasm32-unknown-unknown
export CARGO_TARGET_DIR="${PRESHADE_WEB_TARGET:-$PWD/compiler/target}"
# `-Zbuild-std` and the flags below are not stable.
export RUSTC_BOOTSTRAP=1
cargo=cargo
if ! [ -d "$(rustc --print sysroot 2>/dev/null)/lib/rustlib/src/rust/library" ]; then
    # Found by its path: rustup's compiler comes first in PATH.
    export RUSTC=/usr/bin/rustc RUSTDOC=/usr/bin/rustdoc
    linker=$(command -v wasm-ld || ls /usr/bin/wasm-ld-* 2>/dev/null | sort -V | tail -1)
    export CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER="$linker"
    cargo=/usr/bin/cargo
fi
# A panic aborts without a message, because messages and places take a tenth of the module. The file must not
# name folders of the machine that built it.
registry="${CARGO_HOME:-$HOME/.cargo}/registry/src"
root=$(cd ../.. && pwd)
export CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS="-Zunstable-options -Cpanic=immediate-abort \
    -Zlocation-detail=none --remap-path-prefix=$registry=crates --remap-path-prefix=$root=preshade"

# What `-Oz` of wasm-opt does makes the module smaller as it is, and larger compressed. These two do not.
build() {
    module=$1
    shift
    $cargo build --manifest-path compiler/Cargo.toml --release --locked --target $target \
        -Zbuild-std=std,panic_abort -Zbuild-std-features=optimize_for_size "$@"
    npx wasm-opt --enable-bulk-memory --enable-sign-ext --enable-mutable-globals --enable-nontrapping-float-to-int \
        --enable-reference-types --enable-multivalue --duplicate-function-elimination --reorder-locals \
        "$CARGO_TARGET_DIR/$target/release/preshade_web.wasm" -o "$module"
}
began=$(date +%s)
build preshade.wasm --no-default-features
build preshade-full.wasm
echo "built in $(($(date +%s) - began)) s"
node version.mjs
node tests/size.mjs
