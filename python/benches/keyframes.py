"""Keyframes from arrays to their acks: the package against the Rust client, on one server.

    cargo build --release --example keyframes -p covis-client
    cargo build --release
    COVIS_BIN=target/release/covis python python/benches/keyframes.py target/release/examples/keyframes

Both send the same keyframes (half of the landmarks of each are new) into a map that solves nothing by
itself, in turns, each round into a map of its own. Wall time is from the first keyframe to the last ack,
processor time that of the client's process over the same keyframes (Rust: the whole process, less one
that sends nothing).
"""

from __future__ import annotations

import argparse
import resource
import statistics
import subprocess
import time

import covis
import numpy as np
from covis import v1

K = np.array([[500.0, 0.0, 319.5], [0.0, 500.0, 239.5], [0.0, 0.0, 1.0]])


def view(keyframe: int, observations: int) -> tuple[np.ndarray, ...]:
    ids = keyframe * (observations // 2) + np.arange(observations)
    place = np.arange(observations)
    pixels = np.column_stack([place % 40 * 16.0, place // 40 * 19.0])
    points = np.column_stack([(pixels - [319.5, 239.5]) / 500 * 4, np.full(observations, 4.0)])
    return pixels, ids, np.full(observations, 4.0), points


def in_python(client: covis.Client, map_id: str, views: list[tuple[np.ndarray, ...]]) -> tuple[float, float]:
    with client.ingest(map_id, "robot") as session:
        session.camera(0, 640, 480, K)
        session.flush()
        begin, processor = time.perf_counter(), time.process_time()
        for id, (pixels, ids, depths, points) in enumerate(views):
            session.keyframe(id, 100 + id, np.eye(4), pixels, ids, depths, new_points=points)
        session.finish()
    return time.perf_counter() - begin, time.process_time() - processor


def in_rust(program: str, url: str, map_id: str, keyframes: int, observations: int) -> tuple[float, float]:
    def used() -> float:
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    before = used()
    command = [program, url, map_id, str(keyframes), str(observations)]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return float(said), used() - before


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("program", help="the Rust client's example `keyframes`")
    arguments.add_argument("--keyframes", type=int, default=200)
    arguments.add_argument("--observations", type=int, default=1000)
    arguments.add_argument("--rounds", type=int, default=7)
    given = arguments.parse_args()
    views = [view(id, given.observations) for id in range(given.keyframes)]
    policy = v1.MapPolicy(
        local_bundle_adjustment=False, place_recognition=v1.PlaceRecognition(enabled=False)
    )
    times: dict[str, list[tuple[float, float]]] = {"Python": [], "Rust": []}
    with covis.local() as client:
        for round in range(-1, given.rounds):
            for name in times:
                map_id = f"{name.lower()}-{round}".replace("--1", "-warm")
                client.create_map(map_id, policy)
                if name == "Python":
                    taken = in_python(client, map_id, views)
                else:
                    count = (given.keyframes, given.observations)
                    taken = in_rust(given.program, client.url, map_id, *count)
                    client.create_map(map_id + "-none", policy)
                    _, start = in_rust(given.program, client.url, map_id + "-none", 0, given.observations)
                    taken = (taken[0], taken[1] - start)
                    client.delete_map(map_id + "-none")
                client.delete_map(map_id)
                if round >= 0:
                    times[name].append(taken)
    print(f"{given.keyframes} keyframes of {given.observations} observations, {given.rounds} rounds")
    print("          wall, ms a keyframe   processor, ms a keyframe")
    medians = {}
    for name, taken in times.items():
        medians[name] = [statistics.median(t[k] for t in taken) / given.keyframes * 1e3 for k in (0, 1)]
        print(f"{name:<8}  {medians[name][0]:>19.3f}   {medians[name][1]:>24.3f}")
    ratios = [medians["Python"][k] / medians["Rust"][k] for k in (0, 1)]
    print(f"ratio     {ratios[0]:>19.2f}   {ratios[1]:>24.2f}")


if __name__ == "__main__":
    main()
