#!/bin/sh
# Runs shares of the jobs by GNU parallel. Flags of this script are flags of parallel, such as
# `--sshloginfile machines --workdir .` for machines that share this folder. Then: preshade merge @{out}
set -eu
parallel "$@" <<'END'
@{pictures}END
grep -q '"kind":"time"' @{jobs} || exit 0
# One at a time on each machine.
parallel "$@" --jobs 1 <<'END'
@{times}END
