"""A HyperQueue server, or a worker of it in a process of its own, until stdin ends.

    cluster.py server FOLDER
    cluster.py worker FOLDER OWN

The package starts workers only in the process of their server. A worker reads the address of its server from a file in
the server's folder: this process starts a server that nobody uses, in OWN, and puts the other's file there.
"""
import pathlib
import shutil
import sys

from hyperqueue.ffi.cluster import Cluster

kind, folder, *own = sys.argv[1:]
# A relative path would leave links that lead nowhere.
here = pathlib.Path(own[0] if own else folder).resolve()
here.mkdir(parents=True)
cluster = Cluster(str(here))
if kind == "worker":
    access = (here / "hq-current" / "access.json").resolve()
    # It cannot be written to.
    access.unlink()
    shutil.copy(pathlib.Path(folder) / "hq-current" / "access.json", access)
    cluster.add_worker(1)
sys.stdin.read()
