#!/usr/bin/env bash
# Prepares the release of VERSION in dist/VERSION, and prints the commands that would publish it. It uploads
# nothing.
#
#     scripts/release.sh VERSION
#
# It refuses uncommitted changes, another branch than main, a version that has a tag, is not in the change log or
# differs between the manifests, and anything that fails: tests, licences of dependencies, an API that breaks the version's promise, packages.
set -euo pipefail
cd "$(dirname "$0")/.."
refuse() {
    echo "release: $*" >&2
    exit 1
}
version=${1:-}
[[ $version =~ ^[0-9]+\.[0-9]+\.[0-9]+(-[0-9a-z.]+)?$ ]] || refuse "name the version, such as 1.2.3"
tag=v$version

clean() {
    local changed
    changed=$(git status --porcelain)
    [ -z "$changed" ] || refuse "$1:"$'\n'"$changed"
}
clean "commit these changes first"
branch=$(git branch --show-current)
[ "$branch" = main ] || refuse "this is the branch ${branch:-of no name}, not main"
! git rev-parse --quiet --verify "refs/tags/$tag" >/dev/null || refuse "the tag $tag exists"

# The section's lines, up to the next section.
notes=$(awk -v heading="## $version" '$0 == heading || index($0, heading " ") == 1 { found = 1; next } /^## / { found = 0 } found' CHANGELOG.md)
[[ $notes =~ [^[:space:]] ]] || refuse "CHANGELOG.md says nothing under '## $version'"

# Each place that has the version: FILE and the pattern of its line.
wrong=
while read -r file pattern; do
    found=$(sed -n "s/$pattern/\\1/p" "$file" | head -1)
    [ "$found" = "$version" ] || wrong+=$'\n'"$file: ${found:-none}"
done <<'PLACES'
Cargo.toml ^version = "\(.*\)"$
hosts/bevy/Cargo.toml ^version = "\(.*\)"$
hosts/bevy/Cargo.toml ^preshade = .*version = "\([^"]*\)".*
hosts/web/package.json ^ *"version": "\(.*\)",$
hosts/three/package.json ^ *"version": "\(.*\)",$
hosts/three/package.json ^ *"preshade": "\([0-9][^"]*\)",$
PLACES
found=$(sed -n 's/.* = { version = "\([^"]*\)", path = .*/\1/p' Cargo.toml | sort -u | xargs)
[ "$found" = "$version" ] || wrong+=$'\n'"Cargo.toml, its own crates: ${found:-none}"
[ -z "$wrong" ] || refuse "these are not $version:$wrong"

make test hosts audit || refuse "a test failed"
clean "the tests changed these files"

out=dist/$version
rm -rf "$out"
mkdir -p "$out"
cargo publish --workspace --dry-run --locked
cp "${CARGO_TARGET_DIR:-target}"/package/*-"$version".crate "$out"
for package in web three; do (cd hosts/$package && npm pack --silent --pack-destination "../../$out"); done
scripts/sbom.sh hosts/web/compiler/Cargo.toml wasm32-unknown-unknown "$out/preshade-npm-$version.cdx.json"
scripts/dist.sh
echo "$notes" > "$out.notes.md"
clean "the release changed these files"

cat <<E
$out is ready. Nothing is published. To publish it:
  git tag -a $tag -m $tag && git push origin main $tag
  cargo publish --workspace --locked
  (cd hosts/bevy && cargo publish --locked)
  npm publish $out/preshade-$version.tgz
  npm publish $out/preshade-three-$version.tgz
  gh release create $tag --title $tag --notes-file $out.notes.md $out/*
E
