#!/bin/sh
# Submits a task for each job to a HyperQueue server, in the folder of the inputs, which all workers share.
# `hq job wait all` waits. Then: preshade merge @{out}
set -eu
lines=$(mktemp)
trap 'rm -f "$lines"' EXIT

# A kind of job, and what a task of it asks for.
submit() {
    [ -r @{jobs} ] || { echo "there is no list" @{jobs} >&2; exit 2; }
    grep "\"kind\":\"$1\"" @{jobs} > "$lines" || return 0
    name=preshade-$1
    shift
    # If a worker is lost, its tasks run again. Messages are kept where a task fails.
    hq submit --name "$name" --each-line "$lines" --crash-limit 5 "$@" \
        --stdout none --stderr '%{CWD}/preshade-%{JOB_ID}-%{TASK_ID}.stderr:rm-if-finished' \
        -- sh -c 'printf "%s\n" "$HQ_ENTRY" | "$0" "$@"' @{piped}
}

submit picture
submit time @{request}
