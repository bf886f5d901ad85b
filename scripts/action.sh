#!/usr/bin/env bash
# What the GitHub Action runs: a command of preshade, whose report is Markdown.
#
#     scripts/action.sh agree FOLDER BASE HEAD    # compares the shaders of two revisions
#     scripts/action.sh verify SCENE [PASSES]     # draws a scene with its original and with variants
#
# PASSES are variants, separated by spaces, such as `depth-prepass early-alpha,shadow`; without them
# `verify` chooses. Nothing is timed, because the adapter is a processor.
# The report goes to the job's summary (GITHUB_STEP_SUMMARY), or to stdout. With COMMENT_ON, the
# number of a pull request, it is also a comment on it, by `gh`. PRESHADE is the binary; FAIL_ON is
# the value of `agree --fail-on`. The exit status is that of preshade.
set -euo pipefail
preshade=${PRESHADE:-preshade}
report=$(mktemp)
trap 'rm -f "$report"' EXIT
status=0

case "${1:?a command is missing: agree or verify}" in
  agree)
    folder=${2:?FOLDER is missing} base=${3:?BASE is missing} head=${4:?HEAD is missing}
    if git diff --quiet "$base" "$head" -- "$folder"; then
      echo "### Shaders: none changed" > "$report"
    else
      "$preshade" agree "$base:$folder" "$head:$folder" --as same --format markdown \
        ${FAIL_ON:+--fail-on "$FAIL_ON"} > "$report" || status=$?
    fi
    ;;
  verify)
    scene=${2:?SCENE is missing}
    read -ra passes <<< "${3:-}"
    variants=()
    for variant in "${passes[@]}"; do variants+=(--variant "$variant"); done
    said=$("$preshade" verify "$scene" "${variants[@]}" --time no 2>&1) || status=$?
    case $status in
      0) verdict="no promise is broken" ;;
      1) verdict="a variant broke its promise" ;;
      3) verdict="not measured" ;;
      *) verdict="could not be drawn" ;;
    esac
    printf '### `%s`: %s\n\n```text\n%s\n```\n' "$scene" "$verdict" "$said" > "$report"
    ;;
  *)
    echo "action: unknown command $1: agree or verify" >&2
    exit 2
    ;;
esac
if [ -n "${GITHUB_STEP_SUMMARY:-}" ]; then
  cat "$report" >> "$GITHUB_STEP_SUMMARY"
else
  cat "$report"
fi
if [ -n "${COMMENT_ON:-}" ]; then
  gh pr comment "$COMMENT_ON" --body-file "$report"
fi
exit "$status"
