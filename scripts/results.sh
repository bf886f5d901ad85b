#!/usr/bin/env bash
# Makes the files of docs/results on your adapter: results.sh NAME DIR [PRESHADE]
# writes DIR/NAME-shrine.json and the others. Takes some minutes on a GPU; nothing else may draw. The program xtask
# must be beside PRESHADE: cargo build --release -p preshade-cli -p xtask
# NAME-regret.json is apart, because it takes ten: results.sh NAME DIR PRESHADE regret
set -uo pipefail
cd "$(dirname "$0")/.."
name=$1 dir=$2 preshade=${3:-target/release/preshade}
xtask=$(dirname "$preshade")/xtask
scenes=fixtures/scenes
full=(--size 1920x1080)
failed=0
record() { # FILE ARGUMENTS..: what `preshade` prints as JSON
    local file=$dir/$name-$1.json
    shift
    "$preshade" "$@" --format json >"$file.part" || { echo "results: status $? of: $*" >&2; failed=1; }
    mv "$file.part" "$file"
}
variants() { for v in "$@"; do printf -- '--variant\n%s\n' "$v"; done; }
verify() { # FILE SCENE VARIANTS -- OPTIONS
    local file=$1 scene=$2 of=() options
    shift 2
    while [ "$1" != -- ]; do of+=("$1"); shift; done
    shift
    mapfile -t options < <(variants "${of[@]}")
    record "$file" verify "$scenes/$scene.toml" "${full[@]}" "$@" "${options[@]}"
}

if [ "${4:-}" = regret ]; then
    record regret plan "$scenes"/*.toml --exhaustive --size 1280x720 --frames 1 --seconds 0.15
    exit $failed
fi
depth=(depth-prepass depth-prepass:form=equal early-discard)
verify shrine shrine "${depth[@]}" early-discard:attachment=readonly -- --seconds 1.5 --frames 6
verify shrine-invariant shrine "${depth[@]}" depth-prepass:form=equal,vertex=sliced -- \
    --invariant --seconds 1 --frames 3 --camera wall --camera open
for n in 1 2 5 10 20; do verify overdraw-$n overdraw-$n "${depth[@]}" -- --seconds 0.7; done
verify atrium atrium "${depth[@]}" -- --seconds 1
verify late-depth late-depth depth-prepass early-discard -- --seconds 1
verify late-alpha late-alpha early-alpha early-alpha,depth-prepass -- --seconds 1
verify frag-depth frag-depth "${depth[@]}" -- --seconds 1
verify cobbles cobbles skip-taps:threshold=0 skip-taps:threshold=0.01,budget=0.02 \
    skip-taps:threshold=0.05,budget=0.02 -- --seconds 1
verify museum museum specialize specialize:fold=rounding specialize,depth-prepass -- \
    --frames 2 --seconds 0.3 --time headline
preshade=$xtask record bench bench --layers 2,4,16
preshade=$xtask record bench-hoist bench --layers 2 --grids 16,64,128,256
preshade=$xtask record bench-grass bench --layers 2 --grids 16 --grass 50000,200000,400000

v=visibility-buffer:budget=0.05
for scene in city crowd; do
    verify $scene $scene depth-prepass $v $v,select=id $v,select=tiles $v,form=compute $v,form=binned -- \
        --frames 2 --seconds 0.3 --time headline --order as-given
done
grass=(--sweep instances=50000..400000 --frames 2 --seconds 0.3 --time headline --order as-given)
seen=(depth-prepass $v $v,select=id $v,select=id,words=one $v,form=compute $v,form=compute,words=one
    $v,form=binned)
verify grass grass "${seen[@]}" -- "${grass[@]}"
verify grass-sorted grass "${seen[@]}" -- "${grass[@]}" --set order=ascending
verify grass-opaque grass-opaque "${seen[@]}" -- "${grass[@]}"

hoist=hoist:budget=1,finite=assumed,jumps=carried,threshold=1
levels() { # FORM PATTERN LEVELS..
    local form=$1 pattern=$2
    shift 2
    for level in "$@"; do echo "$hoist,tessellate:form=$form,pattern=$pattern,level=$level"; done
}
teapot=(--camera full --order front-to-back --frames 1 --seconds 0.4 --time headline)
mapfile -t noise < <(levels pulled uniform 1 2 3 4 5 6 8; levels shared uniform 1 2 3 4 5 6 8; levels pulled gl 1 3 5)
verify teapot-noise teapot-noise $hoist "${noise[@]}" -- "${teapot[@]}"
verify teapot-specular teapot-specular $hoist "${noise[@]}" -- "${teapot[@]}"
mapfile -t detailed < <(levels shared uniform 3 8 11 16 24 32 48 64; levels pulled uniform 3 8 11)
verify teapot-noise-detailed teapot-noise-detailed $hoist "${detailed[@]}" -- "${teapot[@]}"
record explore-noise-grid-64 explore "$scenes/noise-grid-64.toml" --size 1280x720 --seconds 13
record plan-shrine plan "$scenes/shrine.toml" --size 1280x720
record plan-overdraw-2 plan "$scenes/overdraw-2.toml" --size 1280x720
exit $failed
