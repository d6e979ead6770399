#!/bin/bash
# A setup study on a Slurm cluster:
#
#   sbatch --ntasks 64 slurm.sh study.toml out/
#
# A Dask scheduler and `eightpost study` run on the first node, and one Dask worker for each task. Only OUT has to be on
# a disk that is still there after the job; FMUs and drive files are sent to the workers. A job that is stopped, by its
# time limit or because a node failed, is resumed by submitting it again with the same folder.
#
#SBATCH --job-name=eightpost
#SBATCH --ntasks=3
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=1G
#SBATCH --time=01:00:00
#SBATCH --no-kill
#SBATCH --requeue
#SBATCH --signal=B:TERM@120
#SBATCH --output=eightpost-%j.log
set -eu

study=${1:?usage: sbatch slurm.sh STUDY.toml OUT [options of eightpost study]}
out=${2:?usage: sbatch slurm.sh STUDY.toml OUT [options of eightpost study]}
shift 2

export OMP_NUM_THREADS=1
port=$((20000 + SLURM_JOB_ID % 20000))
address=tcp://$(hostname):$port
dask scheduler --host "$(hostname)" --port "$port" --no-dashboard &
scheduler=$!

# A worker with one thread for each task. A worker that is killed is not restarted; the others do its work.
srun --kill-on-bad-exit=0 dask worker "$address" --nthreads 1 --no-nanny --no-dashboard --memory-limit 0 \
    --local-directory "${TMPDIR:-/tmp}" --death-timeout 300 &
workers=$!

eightpost study "$study" -o "$out" --workers "$address" "$@" &
main=$!
trap 'kill -TERM "$main"' TERM     # two minutes before the time limit: completed setups become a partial table

status=0
wait "$main" || status=$?
if kill -0 "$main" 2>/dev/null; then    # the trap ended the first wait
    status=0
    wait "$main" || status=$?
fi
kill "$workers" "$scheduler" 2>/dev/null || true
wait || true
exit "$status"
