"""Measures how a list of pictures scales with the workers of this machine, and simulates more workers from the times
of its jobs. Prints JSON.

    scaling.py PRESHADE LIST FOLDER ADAPTER
"""

import glob
import hashlib
import heapq
import json
import os
import subprocess
import sys
import time

COPIES = 100


def main():
    program, jobs, folder, adapter = sys.argv[1:]
    runs = {}
    for workers in (1, 2, 4, 8):
        out = os.path.join(folder, str(workers))
        began = time.time()
        words = ["evaluate", "--kind", "picture", "--jobs", jobs, "--out", out, "--adapter", adapter]
        subprocess.run([program, *words, "--workers", str(workers)], check=True, stderr=subprocess.DEVNULL)
        runs[workers] = time.time() - began
        if workers == 1:
            ends = sorted(os.stat(path).st_mtime for path in glob.glob(os.path.join(out, "*.outcome.json")))
            times = [b - a for a, b in zip([began, *ends], ends)]
    print(json.dumps({
        "schema": "preshade.scaling.v1",
        "cores": os.cpu_count(),
        "jobs": len(times),
        "job_seconds": [round(t, 3) for t in sorted(times)],
        "measured": [
            {"workers": n, "seconds": round(s, 2), "speedup": round(runs[1] / s, 2)} for n, s in runs.items()
        ],
        "simulated": simulated(times),
    }, indent=2))


def simulated(times):
    """A longer list, of the same jobs many times, on workers with cores of their own."""
    many = sorted(times * COPIES, reverse=True)
    whole = sum(many)
    rows = []
    for workers in (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1000):
        free = [0.0] * workers
        for job in many:
            heapq.heapreplace(free, free[0] + job)
        # Keys are hashes: a job falls into any share.
        shares = [0.0] * workers
        for i, job in enumerate(many):
            shares[hash_of(i) % workers] += job
        rows.append({
            "workers": workers,
            "queue_speedup": round(whole / max(free), 1),
            "shares_speedup": round(whole / max(shares), 1),
            "seconds_at_least": round(max(whole / workers, many[0]), 2),
        })
    return {"jobs": len(many), "longest_job_seconds": round(many[0], 2), "rows": rows}


def hash_of(i):
    """Any number for a job, as its key is."""
    return int.from_bytes(hashlib.blake2b(str(i).encode(), digest_size=8).digest(), "little")


main()
