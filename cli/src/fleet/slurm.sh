#!/bin/sh
# Submits arrays to Slurm, a share of the jobs each, in the folder of the inputs, which all nodes share.
# Shares that ended early go on if this runs again. Then: preshade merge @{out}
set -eu
sbatch <<'END'
#!/bin/sh
#SBATCH --job-name=preshade-pictures
#SBATCH --array=1-@{shares}
#SBATCH --requeue
@{request}@{evaluate} --partition "hash:$SLURM_ARRAY_TASK_ID/@{shares}" --kind picture
END
if grep -q '"kind":"time"' @{jobs}; then
    # Other work on a node would change the times.
    sbatch <<'END'
#!/bin/sh
#SBATCH --job-name=preshade-times
#SBATCH --array=1-@{shares}
#SBATCH --requeue
#SBATCH --exclusive
@{request}@{evaluate} --partition "hash:$SLURM_ARRAY_TASK_ID/@{shares}" --kind time
END
fi
