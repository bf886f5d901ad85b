#!/usr/bin/env bash
# Builds the program for Linux that a release offers for download, into dist/VERSION:
#
#   preshade-VERSION-TARGET.tar.gz    the program, its licences, those of what is linked into it, completions, man pages
#   preshade-VERSION.cdx.json         every dependency with its licence, as CycloneDX
#   SHA256SUMS                        of all files in the folder
#
# The program needs glibc 2.31 and nothing else: not musl, with which it could not load a Vulkan driver.
# Needs node, and Python's venv, into which it puts zig (the linker), below target.
set -euo pipefail
cd "$(dirname "$0")/.."
glibc=2.31
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
target=$(rustc --print host-tuple)
built=${CARGO_TARGET_DIR:-target}
out=dist/$version
case "$target" in
    *-linux-gnu) ;;
    *) echo "dist: builds on Linux with glibc, not on $target" >&2; exit 1 ;;
esac

tools=$(realpath -m "$built/dist-tools")
if ! [ -x "$tools/bin/cargo-zigbuild" ]; then
    python3 -m venv "$tools"
    "$tools/bin/pip" install --quiet cargo-zigbuild==0.24.1 ziglang==0.17.1
fi
command -v cargo-cyclonedx >/dev/null || cargo install cargo-cyclonedx --locked --quiet
# Messages of a panic name files, and must not name folders of this machine.
registry=${CARGO_HOME:-$HOME/.cargo}/registry/src
# Who builds for many optimises more than who installs for himself.
CARGO_PROFILE_RELEASE_OPT_LEVEL=3 CARGO_TARGET_DIR=$built PATH="$tools/bin:$PATH" \
    CARGO_ENCODED_RUSTFLAGS="--remap-path-prefix=$registry=crates"$'\x1f'"--remap-path-prefix=$PWD=preshade" \
    cargo zigbuild --release --locked -p preshade-cli --target "$target.$glibc"

program=$built/$target/release/preshade
newest=$(objdump -T "$program" | grep -o 'GLIBC_[0-9.]*' | sed 's/GLIBC_//' | sort -V | tail -1)
if [ "$(printf '%s\n' "$newest" "$glibc" | sort -V | tail -1)" != "$glibc" ]; then
    echo "dist: the program needs glibc $newest, not $glibc" >&2
    exit 1
fi

mkdir -p "$out"
staged=$(mktemp -d)
trap 'rm -rf "$staged"' EXIT
name=preshade-$version-$target
mkdir -p "$staged/$name/completions" "$staged/$name/man"
cp "$program" README.md LICENSE-* "$staged/$name"
node scripts/licenses.mjs preshade cli/Cargo.toml "$target" "$staged/$name/THIRD-PARTY.txt"
for shell in bash zsh fish; do "$program" completions $shell > "$staged/$name/completions/preshade.$shell"; done
"$program" man --out "$staged/$name/man" 2>/dev/null
tar --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$(git log -1 --format=%ct)" \
    -C "$staged" -cf - "$name" | gzip -9n > "$out/$name.tar.gz"

scripts/sbom.sh cli/Cargo.toml "$target" "$out/preshade-$version.cdx.json"
(cd "$out" && find . -maxdepth 1 -type f ! -name SHA256SUMS -printf '%P\0' | sort -z | xargs -0 sha256sum > SHA256SUMS)
ls -l "$out"
