"""The names of covis and its twins, and the command line that each stands for."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
LINEAR_SOLVERS = ("dense-schur", "sparse-schur", "iterative-schur")
BUNDLE = """\
covis                    covis, its own choice of linear solver
covis:LINEAR             covis with dense-schur, sparse-schur or iterative-schur
ceres:LINEAR             the Ceres twin with one of these
ceres:LINEAR:analytic    the same with derivatives by hand
gtsam                    the GTSAM twin, points eliminated first
gtsam:colamd             the same in the order that COLAMD finds"""

STARTS = {"covis": ("given", "odometry", "spanning-tree", "chordal"), "ceres": ("given", "tree"),
          "gtsam": ("given", "tree", "chordal")}
POSE_GRAPH = """\
covis                    covis, its own choice of a start
covis:START              covis from given, odometry, spanning-tree or chordal
ceres:START              the Ceres twin from given (the file's vertices) or tree (measurements strung together)
gtsam:gn:START           the GTSAM twin, Gauss-Newton, from given, tree or chordal (GTSAM's own initialization)
gtsam:lm:START           the same with Levenberg-Marquardt"""

INCREMENTAL = """\
covis                    covis, every step to the optimum
isam2                    GTSAM's iSAM2 as it comes
isam2:THRESHOLD          the same, poses that move by more are relinearized at every step"""


@dataclass
class Programs:
    """Where the solvers are."""

    covis: str = "target/release/covis"
    ceres: str = "target/reference/ceres"


@dataclass
class Settings:
    """What holds for every run."""

    programs: Programs
    max_iterations: int = 100
    fix_intrinsics: bool = False
    timeout_s: float = 600.0


def is_covis(solver: str) -> bool:
    return solver.split(":")[0] == "covis"


def twin(script: str) -> list[str]:
    """A twin in Python. Without -B it would leave compiled files behind."""
    return [sys.executable, "-B", str(HERE / "gtsam" / script)]


def check_bundle(solver: str) -> None:
    """ValueError where the name is none of BUNDLE."""
    name, *words = solver.split(":")
    known = {
        "covis": lambda: len(words) <= 1 and all(w in LINEAR_SOLVERS for w in words),
        "ceres": lambda: len(words) in (1, 2) and words[0] in LINEAR_SOLVERS and words[1:] in ([], ["analytic"]),
        "gtsam": lambda: words in ([], ["colamd"], ["metis"]),
    }
    if name not in known or not known[name]():
        raise ValueError(f"no solver is called {solver}; there are\n{BUNDLE}")


def bundle(solver: str, file: str, threads: int, out: str, settings: Settings) -> list[str]:
    """The command line of one bundle adjustment that writes the solved file to `out`."""
    name, *words = solver.split(":")
    linear = ["--linear-solver", words[0]] if words else []
    common = ["--threads", str(threads), "--max-iterations", str(settings.max_iterations), "--out", out]
    if settings.fix_intrinsics:
        common.append("--fix-intrinsics")
    if name == "covis":
        return [settings.programs.covis, "solve", "bundle", file, "--json", *linear, *common]
    if name == "ceres":
        return [f"{settings.programs.ceres}/bundle", file, *linear, *(f"--{word}" for word in words[1:]), *common]
    ordering = ["--ordering", words[0]] if words else []
    return [*twin("bundle.py"), file, *ordering, *common]


def check_pose_graph(solver: str) -> None:
    """ValueError where the name is none of POSE_GRAPH."""
    method, start = split_start(solver)
    name = method.split(":")[0]
    methods = ("covis", "ceres", "gtsam:gn", "gtsam:lm")
    if method not in methods or start not in (*STARTS[name], "auto" if name == "covis" else ""):
        raise ValueError(f"no solver is called {solver}; there are\n{POSE_GRAPH}")


def split_start(solver: str) -> tuple[str, str]:
    """A name's method and its start; covis without one chooses itself."""
    method, _, start = solver.rpartition(":")
    return (method, start) if method else (solver, "auto")


def pose_graph(solver: str, file: str, threads: int, out: str, settings: Settings) -> list[str]:
    """The command line of one solve of a pose graph that writes its vertices to `out`."""
    method, start = split_start(solver)
    common = ["--threads", str(threads), "--max-iterations", str(settings.max_iterations), "--out", out]
    if method == "covis":
        return [settings.programs.covis, "solve", "pose-graph", file, "--json", "--init", start, *common]
    if method == "ceres":
        return [f"{settings.programs.ceres}/pose_graph", file, "--start", start, *common]
    return [*twin("pose_graph.py"), file, "--method", method.split(":")[1], "--start", start, *common]


def check_incremental(solver: str) -> None:
    """ValueError where the name is none of INCREMENTAL."""
    name, _, threshold = solver.partition(":")
    try:
        known = solver in ("covis", "isam2") or (name == "isam2" and float(threshold) > 0.0)
    except ValueError:
        known = False
    if not known:
        raise ValueError(f"no solver is called {solver}; there are\n{INCREMENTAL}")


def incremental(solver: str, file: str, threads: int, out: str, settings: Settings) -> list[str]:
    """The command line of one growing pose graph that writes its last vertices to `out`."""
    common = ["--threads", str(threads), "--out", out]
    if solver == "covis":
        return [settings.programs.covis, "solve", "pose-graph", file, "--incremental", "--json", *common]
    threshold = solver.partition(":")[2]
    chosen = ["--threshold", threshold, "--skip", "1"] if threshold else []
    return [*twin("incremental.py"), file, *chosen, *common]
