"""A Slurm of one node for tests: all of it in one directory, as root, without systemd.

It needs the Debian packages slurmctld, slurmd, slurm-client and munge. Memory of jobs is not limited, since that takes
control groups that containers often lack.
"""

import os
import pathlib
import shutil
import signal
import socket
import subprocess
import time

PROGRAMS = ["munged", "slurmctld", "slurmd", "sbatch", "sinfo", "scancel"]


def missing():
    """What is not installed, or why it cannot run here; empty if it can."""
    lacking = [name for name in PROGRAMS if shutil.which(name) is None]
    if lacking:
        return f"{', '.join(lacking)} not installed"
    if os.geteuid() != 0:
        return "a node needs the rights of root"
    return ""


def free_ports(count):
    """Ports that nobody listens at now, all different."""
    sockets = [socket.socket() for _ in range(count)]
    for each in sockets:
        each.bind(("127.0.0.1", 0))
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


class Slurm:
    """A cluster that runs while this is entered; commands find it by `environment`."""

    def __init__(self, directory, cpus):
        self.directory = pathlib.Path(directory).resolve()
        self.cpus = cpus
        self.configuration = self.directory / "slurm.conf"
        self.environment = {**os.environ, "SLURM_CONF": str(self.configuration)}

    def __enter__(self):
        try:
            self._start()
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(self, *_):
        self._stop()

    def _start(self):
        munge = self.directory / "munge"
        for name in ["state", "spool", "log"]:
            (self.directory / name).mkdir(parents=True)
        munge.mkdir(mode=0o700)
        key = munge / "key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o400)
        self.configuration.write_text(self._settings(*free_ports(2)))
        files = [f"--{name}={munge / name}" for name in ["socket", "pid-file", "seed-file", "log-file"]]
        # it refuses to run as root without this
        self._run("munged", f"--key-file={key}", *files, "--force")
        self._run("slurmctld", "-f", str(self.configuration), "-c")
        self._run("slurmd", "-f", str(self.configuration), "-c")
        end = time.monotonic() + 60
        while time.monotonic() < end:
            state = subprocess.run(["sinfo", "-h", "-o", "%T"], env=self.environment, capture_output=True, text=True)
            if state.stdout.strip() == "idle":
                return
            time.sleep(0.2)
        logs = [path.read_text()[-800:] for path in sorted((self.directory / "log").iterdir())]
        raise RuntimeError("the node did not become idle\n" + "\n".join(logs))

    def _settings(self, control_port, node_port):
        host = socket.gethostname().split(".")[0]
        at = self.directory
        lines = {
            "ClusterName": "alvis",
            "SlurmctldHost": f"{host}(127.0.0.1)",
            "SlurmUser": "root",
            "SlurmdUser": "root",
            "AuthType": "auth/munge",
            "AuthInfo": f"socket={at}/munge/socket",
            "CryptoType": "crypto/munge",
            "SlurmctldPort": control_port,
            "SlurmdPort": node_port,
            "StateSaveLocation": at / "state",
            "SlurmdSpoolDir": at / "spool",
            "SlurmctldPidFile": at / "slurmctld.pid",
            "SlurmdPidFile": at / "slurmd.pid",
            "SlurmctldLogFile": at / "log" / "slurmctld",
            "SlurmdLogFile": at / "log" / "slurmd",
            "ProctrackType": "proctrack/linuxproc",
            "TaskPlugin": "task/none",
            "JobAcctGatherType": "jobacct_gather/none",
            "AccountingStorageType": "accounting_storage/none",
            "MpiDefault": "none",
            "SwitchType": "switch/none",
            "SelectType": "select/cons_tres",
            "SelectTypeParameters": "CR_Core_Memory",
            "SchedulerType": "sched/backfill",
            "SchedulerParameters": "sched_interval=1,bf_interval=1",
            "ReturnToService": 2,
            "NodeName": f"{host} NodeAddr=127.0.0.1 CPUs={self.cpus} RealMemory=1000 State=UNKNOWN",
            "PartitionName": f"all Nodes={host} Default=YES MaxTime=INFINITE State=UP",
        }
        return "".join(f"{name}={value}\n" for name, value in lines.items())

    def _run(self, *command):
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{command[0]}: {done.stderr or done.stdout}")

    def _stop(self):
        if self.configuration.exists():
            subprocess.run(["scancel", "--user=root"], env=self.environment, capture_output=True)
        for name in ["slurmd.pid", "slurmctld.pid", "munge/pid-file"]:
            path = self.directory / name
            if path.exists():
                try:
                    os.kill(int(path.read_text()), signal.SIGTERM)
                except (ProcessLookupError, ValueError):
                    pass
