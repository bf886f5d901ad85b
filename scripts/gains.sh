#!/bin/sh
# Profiles captured frames and plans each of their passes: `gains.sh PROGRAM OUT ADAPTER FRAME..` writes NAME.profile.json
# and the messages, NAME.txt, for each frame folder, and NAME.PASS.plan.json, with the messages NAME.PASS.txt, for each
# render pass that takes LEAST percent of the frame's time. The plans may change pixels within a budget: what was
# measured without is in them too. tests/capture/survey/gains.mjs makes tables of all this.
set -u
program=$1 out=$2 adapter=$3
least=${LEAST:-8}
shift 3
mkdir -p "$out"
for frame; do
    name=$(basename "$frame")
    "$program" profile "$frame" --adapter "$adapter" --seconds 0.5 --format json \
        > "$out/$name.profile.json" 2> "$out/$name.txt" || rm "$out/$name.profile.json"
    # "note: the frame's time by render pass: 1, full screen of 1 draw, 80 %; 0, main of ..".
    sed -n "s/^note: the frame's time by render pass: //p" "$out/$name.txt" | tr ';' '\n' |
        sed -n 's/^ *\([0-9]*\), \(main\|full screen\|shadow map\) of [^,]*, \([0-9]*\) %.*/\1 \3/p' |
        while read -r pass part; do
            [ "$part" -ge "$least" ] || continue
            "$program" plan "$frame" --render-pass "$pass" --adapter "$adapter" --model "$out/model.json" \
                --seconds 1 --budget flip_mean=0.01 --format json \
                > "$out/$name.$pass.plan.json" 2> "$out/$name.$pass.txt" < /dev/null || rm "$out/$name.$pass.plan.json"
        done
done
