#!/bin/sh
# Profiles and plans captured frames: `gains.sh PROGRAM OUT ADAPTER FRAME..` writes NAME.profile.json, NAME.plan.json,
# NAME.within.json (a plan within a budget), and the messages, NAME.txt, for each frame folder.
# tests/capture/survey/gains.mjs makes tables of them.
set -u
program=$1 out=$2 adapter=$3
shift 3
mkdir -p "$out"
for frame; do
    name=$(basename "$frame")
    "$program" profile "$frame" --adapter "$adapter" --seconds 0.5 --format json \
        > "$out/$name.profile.json" 2> "$out/$name.txt" || rm "$out/$name.profile.json"
    set -- plan "$frame" --adapter "$adapter" --model "$out/model.json" --seconds 1 --format json
    "$program" "$@" > "$out/$name.plan.json" 2>> "$out/$name.txt" || rm "$out/$name.plan.json"
    "$program" "$@" --budget flip_mean=0.01 \
        > "$out/$name.within.json" 2>> "$out/$name.txt" || rm "$out/$name.within.json"
done
