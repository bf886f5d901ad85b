# Submits a task for each job to a HyperQueue server, in the folder of the inputs, which all workers share,
# and waits. Needs the package `hyperqueue` in the server's version; tested with 0.27.0. Then: preshade merge @{out}
import json
import os

from hyperqueue import Client, Job
from hyperqueue.ffi.protocol import ResourceRequest
from hyperqueue.output import StdioDef

tasks = Job(name="preshade", default_workdir=os.getcwd(), max_fails=None)
with open(@{jobs}, encoding="utf-8") as jobs:
    for job in jobs:
        if job.strip():
            is_time = json.loads(job)["kind"] == "time"
            # If a worker is lost, its tasks run again. Messages are kept where a task fails.
            tasks.program(
                @{piped},
                stdin=job,
                stdout=None,
                stderr=StdioDef.remove_if_finished("%{CWD}/preshade-%{JOB_ID}-%{TASK_ID}.stderr"),
                resources=ResourceRequest(@{request}) if is_time else None,
                crash_limit=5,
            )
client = Client(os.environ.get("HQ_SERVER_DIR"))
client.wait_for_jobs([client.submit(tasks)])
