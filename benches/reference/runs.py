"""One run of one solver on one file: the command, its trace, its wall time and peak memory.

covis and its twins print the same JSON document, so that one reader serves all. This module stays
free of numpy: the peak memory of a child counts from its fork, so a large parent would show in it.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).resolve().parent


@dataclass
class Run:
    """What one run left; `error` says why where there is no trace."""

    solver: str
    threads: int
    rows: list[dict] = field(default_factory=list)  # of the document: iteration, cost, seconds
    document: dict = field(default_factory=dict)  # without the rows
    wall_seconds: float = 0.0
    peak_memory_mb: float = 0.0
    blas_core: str = ""  # whose kernels OpenBLAS took, where the solver has it
    error: str = ""

    @property
    def start(self) -> float:
        return self.rows[0]["cost"]

    @property
    def final(self) -> float:
        return self.rows[-1]["cost"]

    @property
    def steps(self) -> int:
        return len(self.rows) - 1

    def ms_a_step(self) -> float:
        """Mean time of a step, rejected ones included; what comes before row 0 is not in it."""
        return 1e3 * (self.rows[-1]["seconds"] - self.rows[0]["seconds"]) / max(1, self.steps)

    def seconds_to(self, cost: float) -> float:
        """Seconds until the cost is at most `cost`; infinite where it never is."""
        return min((row["seconds"] for row in self.rows if row["cost"] <= cost), default=float("inf"))


def environment(threads: int) -> dict[str, str]:
    """What a solver runs in: a BLAS below it has as many threads as it, and its own choice of kernels.

    Whatever else is set here for OpenBLAS or OpenMP stays behind. A forced core type, say, would give
    a twin the kernels of another processor.
    """
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("OPENBLAS_", "OMP_"))}
    # Verbose: it names the core type on stderr.
    return kept | {"OPENBLAS_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads), "OPENBLAS_VERBOSE": "2"}


def run(solver: str, threads: int, command: list[str], out: str, timeout_s: float) -> Run:
    """Runs the command line `command`, which writes `out`, once; whatever goes wrong is told in the result."""
    result = Run(solver, threads)
    Path(out).unlink(missing_ok=True)
    with tempfile.TemporaryFile("w+") as stdout, tempfile.TemporaryFile("w+") as stderr:
        begin = time.perf_counter()
        try:
            process = subprocess.Popen(command, stdout=stdout, stderr=stderr, env=environment(threads))
        except OSError as error:
            result.error = f"{error.strerror}: {error.filename}"
            return result
        timer = threading.Timer(timeout_s, process.kill)
        timer.start()
        _, status, usage = os.wait4(process.pid, 0)
        in_time = timer.is_alive()
        timer.cancel()
        result.wall_seconds = time.perf_counter() - begin
        result.peak_memory_mb = usage.ru_maxrss / 1024.0
        # wait4 took the child's status; Popen must not wait for it again.
        process.returncode = os.waitstatus_to_exitcode(status)
        stdout.seek(0)
        stderr.seek(0)
        told = stderr.read().strip().splitlines()
        result.blas_core = next((line[6:] for line in told if line.startswith("Core: ")), "")
        told = [line for line in told if not line.startswith("Core: ")]
        if process.returncode != 0:
            last = (told or [f"exit code {process.returncode}"])[-1]
            result.error = last[:100] if in_time else f"no end after {timeout_s:.0f} s"
            return result
        read_document(result, stdout.read())
    return result


def read_document(result: Run, text: str) -> None:
    """Takes rows and facts from what a solver printed."""
    try:
        document = json.loads(text)
        keys = ("iteration", "cost", "seconds")
        rows = [{key: row[key] for key in keys} for row in document.pop("iterations")]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        result.error = f"no JSON document of a solve ({error})"
        return
    if not rows:
        result.error = "a trace without rows"
    elif rows[-1]["seconds"] > result.wall_seconds:
        result.error = "its clock runs past the wall's"
    else:
        result.rows, result.document = rows, document


def facts(script: str, *arguments: str) -> dict:
    """Cost and size of a file by bal.py or g2o.py, in a process of its own; ValueError with what it said."""
    done = subprocess.run([sys.executable, "-B", str(HERE / script), *arguments], capture_output=True, text=True)
    if done.returncode != 0:
        raise ValueError((done.stderr.strip().splitlines() or [f"{script} failed"])[-1])
    return json.loads(done.stdout)


def own_peak_memory_mb() -> float:
    """What a child inherits before it becomes the solver: smaller peaks cannot be told apart."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def machine() -> dict:
    """What a time depends on besides the solver."""
    model = ""
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as lines:
            model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")
    except OSError:
        pass
    names = ("RAYON_", "MKL_", "GOTO_")
    return {
        "processor": model or platform.processor(),
        "processors": len(os.sched_getaffinity(0)),
        "system": f"{platform.system()} {platform.release()}",
        "load_average": os.getloadavg(),
        "environment": {key: value for key, value in sorted(os.environ.items()) if key.startswith(names)},
        "time": time.strftime("%Y-%m-%d %H:%M:%S %z"),
    }


def describe(machine_facts: dict) -> str:
    """One paragraph over a table."""
    text = f"{machine_facts['processor']}, {machine_facts['processors']} processors, {machine_facts['system']}; "
    text += f"load {machine_facts['load_average'][0]:.2f} at the start, {machine_facts['time']}"
    set_here = [f"{key}={value}" for key, value in machine_facts["environment"].items()]
    return text + (f"; {', '.join(set_here)}" if set_here else "")


def rotated(items: list, by: int) -> list:
    """`items` from number `by` on and round again: each round another one goes first."""
    by %= max(1, len(items))
    return items[by:] + items[:by]
