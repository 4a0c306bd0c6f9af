"""What users type, checked by mypy in strict mode; nothing runs it."""

from pathlib import Path

import covis
import numpy as np
import numpy.typing as npt
from covis import v1


def blocking(K: npt.NDArray[np.float64], pixels: npt.NDArray[np.float32]) -> None:
    with covis.connect("http://127.0.0.1:7411", token="secret") as client:
        with client.ingest("map", "robot", policy=v1.MapPolicy(window_keyframe_count=10)) as session:
            session.camera(0, 640, 480, K, distortion=[0.1, 0.0, 0.0, 0.0])
            sequence: int = session.keyframe(
                0, 1.5, np.eye(4), pixels, [1, 2], depths=[1.0, np.nan], sigmas=0.01, camera=0
            )
            session.closure(0, 0, ("other", 3), np.eye(4), covis.closure_information(0.01, 0.01))
            session.wait_durable(sequence, timeout=5)
            session.wait_optimized()
            report: covis.IngestReport = session.report
        watched: covis.Map = client.watch("map", on_change=lambda changes: print(changes.keyframes))
        watched.wait(report.revision)
        for id, pose in watched.poses.items():
            print(id, pose @ np.linalg.inv(pose))
        offset = watched.map_from_odom("robot")
        if offset is not None:
            print(offset.shape, [closure.counts for closure in watched.closures])
        print(client.optimize("map").summary.final_cost)
        for job in client.watch_job("nightly"):
            print(job.state)
        paths: list[Path] = client.export_map("map", "out")
        try:
            client.get_map("attic")
        except covis.NotFound as error:
            print(error.reason, error.violations, paths)


async def awaited() -> covis.Trajectory:
    async with await covis.aio.local() as client:
        async with await client.ingest("map", "robot") as session:
            await session.keyframe(0, np.datetime64("2026-01-01"), np.eye(4), np.empty((0, 2)), [])
            await session.wait_optimized()
        async for job in client.watch_job("nightly"):
            print(job.progress.share)
        return await client.trajectory("map", "robot")
