#!/usr/bin/env python3
"""covis beside its twins on the same files, in turn, in one run: a table, raw traces, plots.

Every round runs each solver once, another one first each time. T is the median over the rounds of
the seconds until the cost is at most 1.001 times the best final cost of any solver on that file.
"ratio" is T over the best T of a twin with as many threads; below 1 is faster than every twin.
"peak" is the largest resident memory of the process, reading the file included.

Nothing is taken on trust: a solver's start and final cost must be what bal.py finds in the file and
in the file that it wrote, to 1e-6, and its clock must lie within the wall's. A run that fails this
has no row of numbers; for covis the exit code is then 1.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import runs

DEFAULT_SOLVERS = "covis,ceres:dense-schur,ceres:sparse-schur,ceres:iterative-schur,gtsam"
TOLERANCE = 1e-6
HEAD = "| file | solver | threads | start cost | final cost | iterations | ms/iteration | T (s) | ratio | peak (MB) |"


def arguments() -> argparse.Namespace:
    text = f"{__doc__}\nsolvers:\n{runs.SOLVERS}"
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", metavar="FILE", help="BAL files")
    parser.add_argument("--solvers", default=DEFAULT_SOLVERS, help=f"default: {DEFAULT_SOLVERS}")
    parser.add_argument("--threads", default="1,2", help="default: 1,2")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--max-iterations", type=int, default=100)
    parser.add_argument("--fix-intrinsics", action="store_true", help="6 unknowns a camera instead of 9")
    parser.add_argument("--within", type=float, default=1e-3, help="how close to the best cost T asks for (1e-3)")
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds a run may take")
    parser.add_argument("--covis", default=runs.Programs.covis, metavar="BINARY")
    parser.add_argument("--ceres", default=runs.Programs.ceres, metavar="BINARY")
    parser.add_argument("--json", metavar="PATH", help="write every trace here")
    parser.add_argument("--plot", default="target/reference/plots", metavar="FOLDER",
                        help="where a picture a file goes, of cost against seconds (default: target/reference/plots)")
    parser.add_argument("--no-plot", dest="plot", action="store_const", const="")
    parser.add_argument("--format", choices=["png", "svg"], default="png", help="of the pictures")
    options = parser.parse_args()
    options.solvers = options.solvers.split(",")
    try:
        options.threads = [int(count) for count in options.threads.split(",")]
        for solver in options.solvers:
            runs.check(solver)
    except ValueError as error:
        parser.error(str(error))
    return options


def is_close(a: float, b: float) -> bool:
    return math.isfinite(a) and abs(a - b) <= TOLERANCE * abs(b) + 1e-12


def verify(run: runs.Run, start: float, out: str) -> str:
    """What is false about a run's claims; empty where all hold."""
    if not is_close(run.start, start):
        return f"another objective: starts at {run.start:.6e}, the file costs {start:.6e}"
    try:
        found = runs.facts(out)["cost"]
    except ValueError as error:
        return f"its file cannot be evaluated: {error}"
    if not is_close(run.final, found):
        return f"another objective: claims {run.final:.6e}, its file costs {found:.6e}"
    return ""


def measure(file: str, start: float, options: argparse.Namespace, settings: runs.Settings) -> list[list[runs.Run]]:
    """All runs on a file: a list of rounds for each thread count and solver, in that order."""
    cases = [(threads, solver) for threads in options.threads for solver in options.solvers]
    done: dict[tuple[int, str], list[runs.Run]] = {case: [] for case in cases}
    with tempfile.TemporaryDirectory() as scratch:
        out = os.path.join(scratch, "solved.txt")
        for number in range(options.rounds):
            for threads, solver in runs.rotated(cases, number):
                before = done[threads, solver]
                if before and before[0].error:
                    continue
                run = runs.run(solver, file, threads, out, settings)
                if not run.error and not before:
                    run.error = verify(run, start, out)
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
        twins = [s for s in summaries if s["threads"] == summary["threads"] and not is_covis(s)]
        times = [s["T"] for s in twins if s.get("T") is not None]
        if not summary["error"]:
            comparable = times and summary["T"] is not None
            summary["ratio"] = summary["T"] / min(times) if comparable else None
    return summaries


def is_covis(summary: dict) -> bool:
    return summary["solver"].split(":")[0] == "covis"


def line(summary: dict, floor_mb: float) -> str:
    """A row of the table; memory below the floor is told as at most that."""
    head = f"| {Path(summary['file']).stem} | {summary['solver']} | {summary['threads']} |"
    if summary["error"]:
        return f"{head} | | | | | | {summary['error']} |"
    memory = summary["peak_memory_mb"]
    shown = f"{memory:.0f}" if memory > 1.05 * floor_mb else f"<= {floor_mb:.0f}"
    seconds = "never" if summary["T"] is None else f"{summary['T']:.4f}"
    ratio = "" if summary["ratio"] is None else f"{summary['ratio']:.3f}"
    cells = [
        f"{summary['start']:.6e}", f"{summary['final']:.9e}", str(summary["steps"]),
        f"{summary['ms_a_step']:.2f}", seconds, ratio, shown,
    ]
    return f"{head} {' | '.join(cells)} |"


def main() -> int:
    options = arguments()
    programs = runs.Programs(options.covis, options.ceres)
    settings = runs.Settings(programs, options.max_iterations, options.fix_intrinsics, options.timeout)
    machine = runs.machine()
    unknowns = 6 if options.fix_intrinsics else 9
    print(f"{runs.describe(machine)}.\n{unknowns} unknowns a camera, {options.rounds} rounds, "
          f"T to within {options.within:g} of the best cost.\n")
    print(HEAD)
    print("|---" * HEAD.count(" | ") + "|---|", flush=True)
    record = {"machine": machine, "options": vars(options), "files": []}
    failed = False
    for file in options.files:
        try:
            size = runs.facts(file)
        except ValueError as error:
            sys.exit(f"error: {error}")
        measured = measure(file, size["cost"], options, settings)
        summaries = summarize(file, measured, options.within)
        for summary in summaries:
            print(line(summary, runs.own_peak_memory_mb()), flush=True)
        failed |= any(is_covis(summary) and summary["error"] for summary in summaries)
        traces = [asdict(run) for rounds in measured for run in rounds]
        record["files"].append({**size, "summaries": summaries, "runs": traces})
    if options.json:
        Path(options.json).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    cores = sorted({run["blas_core"] for entry in record["files"] for run in entry["runs"]
                    if run["solver"].startswith("ceres") and run["blas_core"]})
    if cores:
        print(f"\nOpenBLAS below Ceres: kernels for {', '.join(cores)}")
    if options.plot:
        draw(record["files"], options)
    return 1 if failed else 0


def draw(entries: list[dict], options: argparse.Namespace) -> None:
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
            print(plots.draw_traces(entry, options.plot, options.format))


if __name__ == "__main__":
    sys.exit(main())
