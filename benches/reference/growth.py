#!/usr/bin/env python3
"""How the time of an iteration grows with the problem: streets of fixed track length, 10k to 1.5M
observations, a table and a picture.

A street (scenes.py) grows by keyframes; what one of them sees and how long a landmark is tracked do
not change. So the work an observation should not change either, as long as the reduced camera system
stays banded. An iteration's time is the median of the differences between rows of a trace; row 0,
with the setup before it, is told apart. Problems are kept in --work and made once.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import runs
import solvers

SIZES = "10000,30000,100000,300000,1000000,1500000"
# Landmarks a keyframe passes, and about how many observations it makes of them.
LANDMARKS, OBSERVATIONS = 50, 245
FEWEST_KEYFRAMES = 60
COLUMNS = ("solver", "threads", "observations", "cameras", "points", "track", "linear solver", "setup (ms)",
           "ms an iteration", "ns an observation", "peak (MB)", "bytes an observation")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=f"{__doc__}\nsolvers:\n{solvers.BUNDLE}",
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--observations", default=SIZES, help=f"about so many each (default: {SIZES})")
    parser.add_argument("--solvers", default="covis")
    parser.add_argument("--threads", default="1,2", help="default: 1,2")
    parser.add_argument("--iterations", type=int, default=6, help="steps of each solve (default: 6)")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--track", type=float, default=5.0, help="observations a landmark (default: 5)")
    parser.add_argument("--laps", type=int, default=1, help="times round the block (default: 1)")
    parser.add_argument("--fix-intrinsics", action="store_true", help="6 unknowns a camera instead of 9")
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds a run may take")
    parser.add_argument("--work", default="target/reference/scenes", metavar="FOLDER")
    parser.add_argument("--covis", default=solvers.Programs.covis, metavar="BINARY")
    parser.add_argument("--ceres", default=solvers.Programs.ceres, metavar="FOLDER",
                        help=f"where its twins are (default: {solvers.Programs.ceres})")
    parser.add_argument("--json", metavar="PATH", help="write the rows here")
    parser.add_argument("--plot", default="target/reference/plots", metavar="FOLDER",
                        help="where the picture goes (default: target/reference/plots)")
    parser.add_argument("--no-plot", dest="plot", action="store_const", const="")
    parser.add_argument("--format", choices=["png", "svg"], default="png", help="of the picture")
    options = parser.parse_args()
    options.solvers = options.solvers.split(",")
    try:
        options.observations = [int(count) for count in options.observations.split(",")]
        options.threads = [int(count) for count in options.threads.split(",")]
        for solver in options.solvers:
            solvers.check_bundle(solver)
    except ValueError as error:
        parser.error(str(error))
    return options


def scene(count: int, options: argparse.Namespace) -> str:
    """The street with about `count` observations, made if it is not there yet."""
    keyframes = max(FEWEST_KEYFRAMES * options.laps, round(count / OBSERVATIONS * 5.0 / options.track / options.laps))
    keyframes -= keyframes % options.laps
    path = Path(options.work) / f"street-{keyframes}-{options.laps}-{options.track:g}.txt"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_suffix(".part")
        made = [sys.executable, "-B", str(runs.HERE / "scenes.py"), "street", str(unfinished)]
        made += ["--cameras", str(keyframes), "--laps", str(options.laps), "--track", str(options.track)]
        subprocess.run([*made, "--landmarks-per-camera", str(LANDMARKS)], check=True, stdout=subprocess.DEVNULL)
        unfinished.rename(path)
    return str(path)


def row(rounds: list[runs.Run], size: dict, floor_mb: float) -> dict:
    """What the runs of one solver on one street say."""
    steps = [after["seconds"] - before["seconds"] for run in rounds for before, after in zip(run.rows, run.rows[1:])]
    seconds = statistics.median(steps)
    memory = max(run.peak_memory_mb for run in rounds)
    known = memory > 1.05 * floor_mb
    return {
        "solver": rounds[0].solver,
        "threads": rounds[0].threads,
        "observations": size["observations"],
        "cameras": size["cameras"],
        "points": size["points"],
        "track": size["observations"] / size["points"],
        "linear_solver": rounds[0].document.get("linear_solver", ""),
        "setup_ms": 1e3 * statistics.median(run.rows[0]["seconds"] for run in rounds),
        "ms_an_iteration": 1e3 * seconds,
        "ns_an_observation": 1e9 * seconds / size["observations"],
        "peak_memory_mb": memory if known else None,
        "bytes_an_observation": memory * 2.0**20 / size["observations"] if known else None,
    }


def cells(facts: dict) -> list[str]:
    memory = ("", "")
    if facts["peak_memory_mb"] is not None:
        memory = (f"{facts['peak_memory_mb']:.0f}", f"{facts['bytes_an_observation']:.0f}")
    return [
        facts["solver"], str(facts["threads"]), str(facts["observations"]), str(facts["cameras"]),
        str(facts["points"]), f"{facts['track']:.2f}", facts["linear_solver"], f"{facts['setup_ms']:.1f}",
        f"{facts['ms_an_iteration']:.2f}", f"{facts['ns_an_observation']:.0f}", *memory,
    ]


def main() -> int:
    options = arguments()
    programs = solvers.Programs(options.covis, options.ceres)
    settings = solvers.Settings(programs, options.iterations, options.fix_intrinsics, options.timeout)
    machine = runs.machine()
    print(f"{runs.describe(machine)}.\n{6 if options.fix_intrinsics else 9} unknowns a camera, "
          f"median of {options.iterations} iterations in {options.rounds} rounds.\n")
    print(f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|", flush=True)
    rows, failed = [], False
    cases = [(solver, threads) for solver in options.solvers for threads in options.threads]
    for count in options.observations:
        file = scene(count, options)
        size = runs.facts("bal.py", file)
        done: dict[tuple[str, int], list[runs.Run]] = {case: [] for case in cases}
        with tempfile.TemporaryDirectory() as scratch:
            for number in range(options.rounds):
                for solver, threads in runs.rotated(cases, number):
                    out = f"{scratch}/solved.txt"
                    command = solvers.bundle(solver, file, threads, out, settings)
                    run = runs.run(solver, threads, command, out, settings.timeout_s)
                    if not run.error and run.steps == 0:
                        run.error = "no step was made"
                    done[solver, threads].append(run)
        for (solver, threads), rounds in done.items():
            wrong = next((run.error for run in rounds if run.error), "")
            if wrong:
                failed = True
                print(f"| {solver} | {threads} | {size['observations']} {'| ' * 9}| {wrong} |", flush=True)
                continue
            rows.append(row(rounds, size, runs.own_peak_memory_mb()))
            print(f"| {' | '.join(cells(rows[-1]))} |", flush=True)
    if options.json:
        record = {"machine": machine, "options": vars(options), "rows": rows}
        Path(options.json).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    if options.plot and rows:
        draw(rows, options)
    return 1 if failed else 0


def draw(rows: list[dict], options: argparse.Namespace) -> None:
    """The picture, or a line that says why there is none."""
    try:
        # Only now: matplotlib would make the parent large, and with it every child.
        import plots
    except ImportError as error:
        print(f"\nno picture: {error}")
        return
    print(f"\n{plots.draw_growth(rows, options.plot, options.format)}")


if __name__ == "__main__":
    sys.exit(main())
