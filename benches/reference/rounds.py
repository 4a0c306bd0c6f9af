"""Solvers on one file, in turn: every round runs each once, another one first each time.

Nothing is taken on trust: a first run goes through the caller's `verify`, later ones must end at the
same cost. This module stays free of numpy, as runs.py does.
"""

from __future__ import annotations

import math
import os
import statistics
import tempfile
from collections.abc import Callable
from pathlib import Path

import runs
from solvers import is_covis

TOLERANCE = 1e-6

# (solver, threads, where to write the solved file) -> the run
Execute = Callable[[str, int, str], runs.Run]
# (run, the file that it wrote) -> what is false about its claims; empty where all hold
Verify = Callable[[runs.Run, str], str]


def is_close(a: float, b: float) -> bool:
    return math.isfinite(a) and abs(a - b) <= TOLERANCE * abs(b) + 1e-12


def verify_end(run: runs.Run, script: str, *arguments: str) -> str:
    """Whether the file that a run wrote costs what the run claims, by numpy in `script`."""
    try:
        found = runs.facts(script, *arguments)["cost"]
    except ValueError as error:
        return f"its file cannot be evaluated: {error}"
    if not is_close(run.final, found):
        return f"another objective: claims {run.final:.6e}, its file costs {found:.6e}"
    return ""


def measure(cases: list[tuple[int, str]], count: int, execute: Execute, verify: Verify) -> list[list[runs.Run]]:
    """All runs on a file: a list of rounds for each thread count and solver of `cases`, in that order."""
    done: dict[tuple[int, str], list[runs.Run]] = {case: [] for case in cases}
    with tempfile.TemporaryDirectory() as scratch:
        out = os.path.join(scratch, "solved")
        for number in range(count):
            for threads, solver in runs.rotated(cases, number):
                before = done[threads, solver]
                if before and before[0].error:
                    continue
                run = execute(solver, threads, out)
                if not run.error and not before:
                    run.error = verify(run, out)
                elif not run.error and not is_close(run.final, before[0].final):
                    run.error = f"ends at {run.final:.6e}, in an earlier round at {before[0].final:.6e}"
                if run.error:
                    before.insert(0, run)  # the first run speaks for all
                else:
                    before.append(run)
    return [done[case] for case in cases]


def finite(x: float) -> float | None:
    """`x`, or None, which JSON has a word for, where it is infinite or no number."""
    return x if math.isfinite(x) else None


def summarize(file: str, measured: list[list[runs.Run]], within: float) -> list[dict]:
    """One summary a thread count and solver; T is None where the cost is never reached, ratio where
    there is nothing to compare."""
    finals = [run.final for rounds in measured for run in rounds if not rounds[0].error]
    target = (1.0 + within) * min(finals, default=math.nan)
    summaries = []
    for rounds in measured:
        first = rounds[0]
        summary = {"file": file, "solver": first.solver, "threads": first.threads, "error": first.error}
        if not first.error:
            summary |= {
                "start": first.start,
                "final": first.final,
                "steps": first.steps,
                "ms_a_step": statistics.median(run.ms_a_step() for run in rounds),
                "T": finite(statistics.median(run.seconds_to(target) for run in rounds)),
                "peak_memory_mb": max(run.peak_memory_mb for run in rounds),
            }
        summaries.append(summary)
    for summary in summaries:
        twins = [s for s in summaries if s["threads"] == summary["threads"] and not is_covis(s["solver"])]
        times = [s["T"] for s in twins if s.get("T") is not None]
        if not summary["error"]:
            comparable = times and summary["T"] is not None
            summary["ratio"] = summary["T"] / min(times) if comparable else None
    return summaries


def cells(summary: dict, floor_mb: float) -> list[str]:
    """What a row of a table says after the file, the solver and its threads; memory below the floor is
    told as at most that."""
    if summary["error"]:
        return ["", "", "", "", "", "", summary["error"]]
    memory = summary["peak_memory_mb"]
    return [
        f"{summary['start']:.6e}", f"{summary['final']:.9e}", str(summary["steps"]), f"{summary['ms_a_step']:.2f}",
        "never" if summary["T"] is None else f"{summary['T']:.4f}",
        "" if summary["ratio"] is None else f"{summary['ratio']:.3f}",
        f"{memory:.0f}" if memory > 1.05 * floor_mb else f"<= {floor_mb:.0f}",
    ]


def name(file: str) -> str:
    """A file's name in a table."""
    return Path(file).stem


def rule(head: str) -> str:
    """The line below a table's head."""
    return "|---" * head.count(" | ") + "|---|"


def draw(entries: list[dict], folder: str, kind: str, incremental: bool = False) -> None:
    """A picture for each file that a solver solved, or a line that says why there is none."""
    try:
        # Only now: matplotlib would make the parent large, and with it every child.
        import plots
    except ImportError as error:
        print(f"\nno pictures: {error}")
        return
    print()
    for entry in entries:
        if any(not run["error"] for run in entry["runs"]):
            print((plots.draw_incremental if incremental else plots.draw_traces)(entry, folder, kind))


def print_blas(entries: list[dict]) -> None:
    """Whose kernels OpenBLAS took below Ceres."""
    cores = sorted({run["blas_core"] for entry in entries for run in entry["runs"]
                    if run["solver"].startswith("ceres") and run["blas_core"]})
    if cores:
        print(f"\nOpenBLAS below Ceres: kernels for {', '.join(cores)}")
