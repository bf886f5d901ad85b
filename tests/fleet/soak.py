"""Runs a list of 500 jobs again and again, for SECONDS, and disturbs it: processes are killed, devices are lost,
the disk fills up, the clock is set back. Prints what came of it, as JSON.

    soak.py PRESHADE SECONDS FOLDER [SEED]

FOLDER is made. It must be on a file system of its own, of a few MiB, if the disk shall fill up (`mount -t tmpfs -o
size=40m none FOLDER`). Needs a C compiler, Vulkan's headers, and libfaketime for the clock.
"""

import collections
import difflib
import glob
import itertools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time

SCENE = """
size = [16, 12]
[materials.stone]
shader = "soak.wgsl"
[meshes]
quad.plane = { size = [2, 2] }
[[draws]]
mesh = "quad"
material = "stone"
[[cameras]]
eye = [0.3, 2, 0.2]
target = [0, 0, 0]
"""
SHADER = """
struct Uniforms { view_projection: mat4x4<f32> }
@group(0) @binding(0) var<uniform> u: Uniforms;
struct Varyings { @builtin(position) clip: vec4<f32>, @location(0) at: vec3<f32> }
@vertex fn vs(@location(0) position: vec3<f32>) -> Varyings {
    return Varyings(u.view_projection * vec4(position, 1.0), position);
}
@fragment fn fs(v: Varyings) -> @location(0) vec4<f32> {
    return vec4(sin(v.at * 7.0) * 0.5 + 0.5, 1.0);
}
"""
FAKETIME = next(iter(glob.glob("/usr/lib/*/faketime/libfaketime.so.1")), None)


def main():
    program, seconds, folder = os.path.abspath(sys.argv[1]), float(sys.argv[2]), os.path.abspath(sys.argv[3])
    chance = random.Random(int(sys.argv[4]) if len(sys.argv) > 4 else 1)
    here = os.path.dirname(os.path.abspath(__file__))
    os.makedirs(folder, exist_ok=True)
    layer = os.path.join(folder, "layer")
    os.makedirs(layer, exist_ok=True)
    shutil.copy(os.path.join(here, "lost.json"), layer)
    subprocess.run(
        ["cc", "-shared", "-fPIC", "-o", os.path.join(layer, "lost.so"), os.path.join(here, "lost.c")], check=True
    )
    lose = os.path.join(folder, "lose")
    environment = dict(
        os.environ, VK_LAYER_PATH=layer, VK_INSTANCE_LAYERS="VK_LAYER_PRESHADE_lost", LOSE=lose, TMPDIR=folder
    )

    def run(*words):
        done = subprocess.run([program, *words], cwd=folder, env=environment, capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"{words}: {done.returncode}: {done.stderr}")
        return done

    with open(os.path.join(folder, "soak.toml"), "w") as file:
        file.write(SCENE)
    with open(os.path.join(folder, "soak.wgsl"), "w") as file:
        file.write(SHADER)
    variants = [f"--variant=hoist:budget=1,threshold=0.{n:03}" for n in range(1, 251)]
    listed = run("jobs", "soak.toml", "--frames=1", "--time=headline", "--seconds=0.02", *variants).stdout
    jobs = [json.loads(line) for line in listed.splitlines()]
    with open(os.path.join(folder, "jobs.jsonl"), "w") as file:
        file.write(listed)
    evaluate = [program, "evaluate", "--jobs", "jobs.jsonl", "--workers", "2", "--attempts", "1000", "--seconds", "20"]
    run(*evaluate[1:], "--kind", "picture", "--out", "whole")
    run("merge", "whole", "-o", "whole.json")
    with open(os.path.join(folder, "whole.json")) as file:
        whole = file.read()

    faults = collections.Counter()
    rounds = []
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        began = time.monotonic()
        memory = []
        starts = 0
        while True:
            starts += 1
            variables = dict(environment)
            if FAKETIME and starts > 1 and chance.random() < 0.2:
                variables.update(LD_PRELOAD=FAKETIME, FAKETIME=f"-{chance.randrange(1, 7200)}s")
                faults["clock set back"] += 1
            child = subprocess.Popen(
                [*evaluate, "--out", "out"], cwd=folder, env=variables, stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE, text=True,
            )
            disturb(child, folder, lose, chance, faults, memory)
            said = child.communicate()[1]
            if child.returncode == 0 and " 0 failed" in said:
                break
            if child.returncode not in (0, 2, -signal.SIGKILL):
                sys.exit(f"evaluate ended with {child.returncode}: {said}")
        keys = collections.Counter()
        for path in glob.glob(os.path.join(folder, "out", "*.outcome.json")):
            with open(path) as file:
                keys[json.load(file)["job"]["key"]] += 1
        # Times differ between runs, pictures do not.
        merged = run("merge", "out", "--format", "json").stdout
        pictures = os.path.join(folder, "pictures")
        os.makedirs(pictures, exist_ok=True)
        for path in glob.glob(os.path.join(folder, "out", "*.outcome.json")):
            with open(path) as file:
                if json.load(file)["job"]["kind"] == "picture":
                    shutil.move(path, pictures)
        run("merge", "pictures", "-o", "parts.json")
        with open(os.path.join(folder, "parts.json")) as file:
            parts = file.read()
        rounds.append({
            "seconds": round(time.monotonic() - began, 1),
            "starts": starts,
            "jobs": len(jobs),
            "lost": len({job["key"] for job in jobs} - set(keys)),
            "merged": len(json.loads(merged)["jobs"]),
            "pictures_as_undisturbed": parts == whole,
            "most_memory_mib": round(max(memory, default=0) / 1024, 1),
            "left_over": len([n for n in os.listdir(os.path.join(folder, "out")) if n.startswith(".")]),
        })
        if parts != whole:
            differ = difflib.unified_diff(whole.splitlines(), parts.splitlines(), "undisturbed", "disturbed", n=2, lineterm="")
            rounds[-1]["differ"] = list(itertools.islice(differ, 100))
        print(json.dumps(rounds[-1]), file=sys.stderr, flush=True)
        shutil.rmtree(os.path.join(folder, "out"))
        shutil.rmtree(pictures)
    print(json.dumps({
        "schema": "preshade.soak.v1",
        "seconds": round(seconds),
        "rounds": rounds,
        "faults": dict(sorted(faults.items())),
        "lost": sum(r["lost"] for r in rounds),
        "wrong": sum(not r["pictures_as_undisturbed"] for r in rounds),
    }, indent=2))


def fill(path):
    """Fills the disk."""
    file = os.open(path, os.O_WRONLY | os.O_CREAT)
    try:
        while True:
            os.write(file, bytes(4096))
    except OSError:
        pass
    os.close(file)


def disturb(child, folder, lose, chance, faults, memory):
    """Waits for a process, and does something to it now and then."""
    filler = os.path.join(folder, "filler")
    next_fault = time.monotonic() + chance.uniform(1, 12)
    undo = None
    while child.poll() is None:
        time.sleep(0.1)
        try:
            with open(f"/proc/{child.pid}/status") as file:
                lines = [line for line in file if line.startswith("VmHWM:")]
            memory.extend(int(line.split()[1]) for line in lines)
        except OSError:
            pass
        if undo and time.monotonic() > undo[0]:
            os.remove(undo[1])
            undo = None
        if undo or time.monotonic() < next_fault:
            continue
        next_fault = time.monotonic() + chance.uniform(1, 12)
        fault = chance.choice(["killed", "a job killed", "device lost", "disk full"])
        if fault == "killed":
            child.kill()
        elif fault == "a job killed":
            with open(f"/proc/{child.pid}/task/{child.pid}/children") as file:
                own = file.read().split()
            # Those of its threads are listed by thread.
            for path in glob.glob(f"/proc/{child.pid}/task/*/children"):
                try:
                    with open(path) as file:
                        own.extend(file.read().split())
                except OSError:
                    pass
            if not own:
                continue
            try:
                os.kill(int(chance.choice(own)), signal.SIGKILL)
            except OSError:
                continue
        elif fault == "device lost":
            open(lose, "w").close()
            undo = (time.monotonic() + 1, lose)
        else:
            if not os.path.ismount(folder):
                continue
            fill(filler)
            undo = (time.monotonic() + 1, filler)
        faults[fault] += 1
    if undo:
        os.remove(undo[1])


main()
