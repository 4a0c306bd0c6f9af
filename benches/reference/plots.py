"""Pictures of what compare.py, pose_graphs.py and growth.py measured. Needs: matplotlib (pip)."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402

# The relative decrease at which the solvers stop: a smaller gap says nothing.
SMALLEST_GAP = 1e-9
STYLES = ("-", "--", ":", "-.")
SIZES = ("cameras", "points", "observations", "vertices", "edges")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def colors(solvers: list[str]) -> dict[str, str]:
    """covis in black, each twin in a color of its own."""
    others = [solver for solver in solvers if solver != "covis"]
    return {"covis": "black"} | {solver: f"C{k}" for k, solver in enumerate(others)}


def unique(values) -> list:
    """The different values in the order of their first."""
    return list(dict.fromkeys(values))


def draw_traces(entry: dict, folder: str, kind: str) -> Path:
    """Relative gap to the best cost against seconds, both logarithmic; returns the file.

    Of each solver and thread count the run with the median time is shown.
    """
    good = [(run["solver"], run["threads"], run) for run in entry["runs"] if not run["error"]]
    best = min((row["cost"] for _, _, run in good for row in run["rows"]), default=1.0)
    color = colors(unique(solver for solver, _, _ in good))
    style = dict(zip(unique(threads for _, threads, _ in good), STYLES * 8))
    figure, axes = plt.subplots(figsize=(8.0, 5.0), layout="constrained")
    for solver, threads in unique((solver, threads) for solver, threads, _ in good):
        mine = [run for s, t, run in good if (s, t) == (solver, threads)]
        mine.sort(key=lambda run: run["rows"][-1]["seconds"])
        rows = mine[(len(mine) - 1) // 2]["rows"]
        seconds = [max(row["seconds"], 1e-6) for row in rows]
        gaps = [max(row["cost"] / best - 1.0, SMALLEST_GAP) for row in rows]
        label = f"{solver}, {threads} thread{'s' if threads > 1 else ''}"
        axes.step(seconds, gaps, where="post", color=color[solver], linestyle=style[threads], label=label,
                  linewidth=2.0 if solver == "covis" else 1.2)
        axes.plot(seconds[-1:], gaps[-1:], marker="o", color=color[solver], markersize=4)
    axes.axhline(1e-3, color="gray", linewidth=0.6)
    axes.set(xscale="log", yscale="log", xlabel="seconds", ylabel="cost / best cost - 1")
    axes.set_title(title(entry))
    axes.legend(fontsize="small")
    return save(figure, folder, f"{Path(entry['file']).stem}.{kind}")


def title(entry: dict) -> str:
    sizes = ", ".join(f"{entry[what]} {what}" for what in SIZES if what in entry)
    return f"{Path(entry['file']).stem}: {sizes}"


def draw_incremental(entry: dict, folder: str, kind: str) -> Path:
    """Seconds so far, and the excess over the lowest cost of all, against vertices; returns the file.

    Of each solver and thread count the first run is shown; costs with the fewest threads only, and
    where there are closures enough to cost more than a hundredth of the last.
    """
    good = [run for run in entry["runs"] if not run["error"]]
    lowest: dict[int, float] = {}
    for run in good:
        for row in run["rows"]:
            lowest[row["iteration"]] = min(row["cost"], lowest.get(row["iteration"], float("inf")))
    color = colors(unique(run["solver"] for run in good))
    style = dict(zip(unique(run["threads"] for run in good), STYLES * 8))
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.5), layout="constrained")
    for solver, threads in unique((run["solver"], run["threads"]) for run in good):
        rows = next(run["rows"] for run in good if (run["solver"], run["threads"]) == (solver, threads))
        look = {"color": color[solver], "linestyle": style[threads]}
        look["label"] = f"{solver}, {threads} thread{'s' if threads > 1 else ''}"
        left.plot([row["iteration"] for row in rows], [row["seconds"] for row in rows], **look)
        rows = [row for row in rows if lowest[row["iteration"]] > 1e-2 * lowest[max(lowest)]]
        if threads == min(style):
            gaps = [max(row["cost"] / lowest[row["iteration"]] - 1.0, SMALLEST_GAP) for row in rows]
            right.plot([row["iteration"] for row in rows], gaps, **look)
    left.set(yscale="log", xlabel="vertices", ylabel="seconds so far")
    right.set(yscale="log", xlabel="vertices", ylabel="cost / lowest cost - 1")
    left.legend(fontsize="small")
    figure.suptitle(title(entry))
    return save(figure, folder, f"{Path(entry['file']).stem}-incremental.{kind}")


def draw_growth(rows: list[dict], folder: str, kind: str) -> Path:
    """Milliseconds an iteration and nanoseconds an observation against observations; returns the file."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.5), layout="constrained")
    color = colors(unique(row["solver"] for row in rows))
    cases = unique((row["solver"], row["threads"]) for row in rows)
    style = dict(zip(unique(threads for _, threads in cases), STYLES * 8))
    for k, (solver, threads) in enumerate(cases):
        mine = [row for row in rows if (row["solver"], row["threads"]) == (solver, threads)]
        count = [row["observations"] for row in mine]
        label = f"{solver}, {threads} thread{'s' if threads > 1 else ''}"
        look = {"color": color[solver], "linestyle": style[threads], "label": label}
        look["marker"] = MARKERS[k % len(MARKERS)]
        left.plot(count, [row["ms_an_iteration"] for row in mine], **look)
        right.plot(count, [row["ns_an_observation"] for row in mine], **look)
    left.set(xscale="log", yscale="log", xlabel="observations", ylabel="ms an iteration")
    right.set(xscale="log", xlabel="observations", ylabel="ns an iteration and observation")
    right.set_ylim(bottom=0.0)
    left.legend(fontsize="small")
    return save(figure, folder, f"growth.{kind}")


def save(figure, folder: str, name: str) -> Path:
    Path(folder).mkdir(parents=True, exist_ok=True)
    path = Path(folder) / name
    figure.savefig(path, dpi=150)
    plt.close(figure)
    return path
