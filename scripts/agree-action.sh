#!/usr/bin/env bash
# Compares the shaders of two revisions and reports the differences as Markdown.
#
#     scripts/agree-action.sh FOLDER BASE HEAD
#
# The report goes to the job's summary (GITHUB_STEP_SUMMARY), or to stdout. With COMMENT_ON, the
# number of a pull request, it is also a comment on it, by `gh`. PRESHADE is the binary; FAIL_ON is
# the value of --fail-on. The exit status is that of `preshade agree`.
set -euo pipefail
folder=${1:?FOLDER is missing} base=${2:?BASE is missing} head=${3:?HEAD is missing}
preshade=${PRESHADE:-preshade}
report=$(mktemp)
trap 'rm -f "$report"' EXIT

if git diff --quiet "$base" "$head" -- "$folder"; then
  echo "### Shaders: none changed" > "$report"
  status=0
else
  status=0
  "$preshade" agree "$base:$folder" "$head:$folder" --as same --format markdown \
    ${FAIL_ON:+--fail-on "$FAIL_ON"} > "$report" || status=$?
fi
if [ -n "${GITHUB_STEP_SUMMARY:-}" ]; then
  cat "$report" >> "$GITHUB_STEP_SUMMARY"
else
  cat "$report"
fi
if [ -n "${COMMENT_ON:-}" ]; then
  gh pr comment "$COMMENT_ON" --body-file "$report"
fi
exit "$status"
