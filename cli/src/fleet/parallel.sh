#!/bin/sh
# Runs shares of the jobs by GNU parallel. Flags of this script are flags of parallel, such as
# `--sshloginfile machines --workdir .` for machines that share this folder. Then: preshade merge @{out}
set -eu
status=0
parallel "$@" <<'END' || status=$?
@{pictures}END
grep -q '"kind":"time"' @{jobs} || exit $status
# One at a time on each machine.
parallel "$@" --jobs 1 <<'END' || status=$?
@{times}END
exit $status
