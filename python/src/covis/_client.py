"""A connection to a server, and its calls.

Streamed and paged answers are collected here. Calls with one answer that solve nothing have a deadline
(`LinkOptions.deadline_s`), within which those that may be repeated are (`LinkOptions.retry`).
"""

from __future__ import annotations

import logging
import os
import tempfile
import weakref
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import aclosing
from pathlib import Path
from typing import Any

import numpy.typing as npt
from google.protobuf.message import Message

from . import _files, _maps, _problems, errors
from ._link import Link
from ._map import Map, WatchOptions
from ._maps import MapDigests
from ._mirror import MapChanges
from ._problems import BundleSolution, Localization, PoseGraphSolution, RefinedPose
from ._retry import Retries, RetryPolicy
from ._server import LocalServer
from ._session import Session
from ._settled import wait_settled
from ._stream import SessionOptions
from ._wait import within
from .errors import RejectedItem
from .trajectory import Trajectory
from .v1 import (
    Camera,
    CancelJobRequest,
    CreateJobRequest,
    CreateMapRequest,
    DeleteJobRequest,
    DeleteMapRequest,
    DownloadJobFilesRequest,
    ExportMapRequest,
    GetJobRequest,
    GetMapRequest,
    GetServerInfoRequest,
    GetServerInfoResponse,
    ImportMapHeader,
    ImportMapRequest,
    ImportWarning,
    IngestAck,
    IterationSummary,
    Job,
    JobSpec,
    JobState,
    ListJobsRequest,
    ListMapsRequest,
    MapPolicy,
    MapProblem,
    OptimizeMapRequest,
    OptimizeMapResult,
    SolveBundleRequest,
    SolvePoseGraphRequest,
    UploadJobFilesRequest,
    WatchJobRequest,
)
from .v1 import Map as MapInfo

_LOG = logging.getLogger("covis")
_ENDED = (JobState.JOB_STATE_SUCCEEDED, JobState.JOB_STATE_FAILED, JobState.JOB_STATE_CANCELLED)
_SOLVING = ("RefinePose", "Localize", "SolveBundle", "SolvePoseGraph", "CopyMap", "MergeMaps", "UndoMerge")


class Client:
    """A connection to a server, from `connect` or `local`.

    A broken connection is made again by the next call. Closing it ends its sessions and watches.
    """

    def __init__(self, link: Link, server: LocalServer | None = None) -> None:
        self._link = link
        self._server = server
        self._open: weakref.WeakSet[Session | Map] = weakref.WeakSet()

    async def __aenter__(self) -> Client:
        return self

    async def __aexit__(self, kind: object, error: object, trace: object) -> None:
        await self.close()

    @property
    def url(self) -> str:
        """The address that calls go to: of several servers that of the one that is talked to."""
        return self._link.url

    async def close(self) -> None:
        """Ends sessions at once and watches, closes the connection, and stops a server of its own."""
        for child in list(self._open):
            await (child.abort() if isinstance(child, Session) else child.close())
        await self._link.close()
        if self._server is not None:
            await self._server.stop()

    async def call(self, request: Message, timeout: float | None = None) -> Any:
        """Makes the call that takes this request of the wire and has one answer, `MergeMaps` say.

        Calls that solve have no deadline of their own.
        """
        is_solve = request.DESCRIPTOR.name.removesuffix("Request") in _SOLVING
        return await self._link.unary(request, timeout, is_solve)

    async def answers(self, request: Message, timeout: float | None = None) -> AsyncIterator[Any]:
        """Makes the call that takes this request of the wire and has many answers, `ListLandmarks` say."""
        async with aclosing(self._link.answers(request, timeout)) as answers:  # type: ignore[type-var]
            async for answer in answers:
                yield answer

    async def server_info(self) -> GetServerInfoResponse:
        """Version, limits, durability and features of the server."""
        answer: GetServerInfoResponse = await self._link.unary(GetServerInfoRequest())
        return answer

    async def create_map(self, map_id: str, policy: MapPolicy | None = None) -> MapInfo:
        """Creates an empty map; without a policy it has the server's. Raises `AlreadyExists`."""
        request = CreateMapRequest(map_id=map_id, policy=policy)
        return _map_of(await self._link.unary(request))

    async def get_map(self, map_id: str) -> MapInfo:
        """One map with its policy and counts. Raises `NotFound`."""
        return _map_of(await self._link.unary(GetMapRequest(map_id=map_id)))

    async def map_digests(self, map_id: str) -> MapDigests:
        """Digests of what a map holds, by which maps of servers of one version are compared."""
        return await _maps.digests(self._link, map_id)

    async def wait_settled(
        self, map_id: str, timeout: float | None = None, retry: RetryPolicy = RetryPolicy()
    ) -> None:
        """Waits until a map is settled: the server does nothing more to it by itself.

        Solves have covered all items of all clients, no place is still to be searched, no adjustment
        after loop closures is due or runs, and no requested optimization runs. A map that others go on
        sending to may not settle for as long as they do. Raises `NotFound`; `MapNotOpen` where the map is
        frozen or poisoned and its work waits; `TimeoutError`; `RetriesExhausted`.
        """
        await within(timeout, wait_settled(self._link.apart(), map_id, retry), "not settled")

    async def list_maps(self) -> list[MapInfo]:
        """All maps by `map_id`."""
        maps: list[MapInfo] = []
        request = ListMapsRequest()
        while True:
            page = await self._link.unary(request)
            maps += page.maps
            if not page.next_page_token:
                return maps
            request = ListMapsRequest(page_token=page.next_page_token)

    async def delete_map(self, map_id: str) -> None:
        """Deletes a map with its journal. Raises `NotFound`."""
        await self._link.unary(DeleteMapRequest(map_id=map_id))

    async def ingest(
        self,
        map_id: str,
        client_id: str,
        *,
        create: bool = True,
        policy: MapPolicy | None = None,
        max_unanswered: int = 64,
        lock_step: bool = False,
        omit_solve_summary: bool = False,
        retry: RetryPolicy = RetryPolicy(),
        on_ack: Callable[[IngestAck], None] | None = None,
        on_rejected: Callable[[RejectedItem], None] | None = None,
    ) -> Session:
        """Opens a session that sends what `client_id` sees into a map.

        - `create`: creates the map, with `policy`, where it is missing.
        - `max_unanswered`: items without an answer; with more of them sending waits.
        - `lock_step`: each solve finishes before the server takes the next item.
        - `omit_solve_summary`: acks come without the certificates of solves.
        - `retry`: when to give a broken link up.
        - `on_ack`: called with each ack. `on_rejected`: called with each item that was refused for
          good; without it, waiting and `finish` raise `Rejected`. Both run on the event loop: they
          must not block, and not call blocking methods.

        Raises `NotFound`, `FailedPrecondition` for a frozen map, `RetriesExhausted`.
        """
        if create:
            await _maps.ensure(self._link, map_id, policy, retry)
        options = SessionOptions(
            max_unanswered, lock_step, omit_solve_summary, retry, on_ack, on_rejected
        )
        session = Session(self._link.apart(), map_id, client_id, options)
        try:
            await session._open()
        except BaseException:
            await session.abort()
            raise
        self._open.add(session)
        return session

    async def watch(
        self,
        map_id: str,
        *,
        omit_landmarks: bool = False,
        omit_constraints: bool = False,
        position_resolution_m: float = 0.0,
        rotation_resolution_rad: float = 0.0,
        retry: RetryPolicy = RetryPolicy(),
        on_change: Callable[[MapChanges], None] | None = None,
    ) -> Map:
        """Follows a map; returns once its full state is there.

        Positions and rotations that change by less than a resolution wait until they have changed
        more. `on_change` is called after each delta, on the event loop: it must not block, and not
        call blocking methods. Raises `NotFound`, `RetriesExhausted`.
        """
        options = WatchOptions(
            omit_landmarks, omit_constraints, position_resolution_m, rotation_resolution_rad,
            retry, on_change,
        )  # fmt: skip
        found = Map(self._link.apart(), map_id, options)
        await found._open()
        self._open.add(found)
        return found

    async def trajectory(self, map_id: str, client_id: str | None = None) -> Trajectory:
        """The poses of one client's keyframes; of the only client by default."""
        return await _maps.trajectory(self._link, map_id, client_id)

    async def export_map(
        self,
        map_id: str,
        folder: str | os.PathLike[str],
        format: str = "colmap-binary",
        *,
        all_points: bool = False,
    ) -> list[Path]:
        """Writes a map as files into `folder` and returns their paths.

        `format`: "colmap-binary", "colmap-text", "tum", "g2o", "ply" or "covis" (all of the map).
        `all_points`: of COLMAP, also the points that fewer than two keyframes observe, which COLMAP's
        bundle adjustment refuses.
        """
        request = ExportMapRequest(
            map_id=map_id,
            format=_files.format_number(format),  # type: ignore[arg-type]
            all_landmarks=all_points,
        )
        async with aclosing(self._link.answers(request)) as answers:  # type: ignore[type-var]
            return await _files.write("ExportMap", answers, Path(folder))

    async def import_map(
        self,
        map_id: str,
        path: str | os.PathLike[str],
        format: str = "colmap-binary",
        *,
        client_id: str = "",
        policy: MapPolicy | None = None,
        skip_unknown: bool = False,
        on_warning: Callable[[ImportWarning], None] | None = None,
    ) -> MapInfo:
        """Creates a map from a file, or from a folder with a COLMAP model.

        `format`: "colmap-binary", "colmap-text", "tum", "g2o" or "covis". `client_id` owns what comes
        from a format without clients ("import"). `skip_unknown` leaves out lines of g2o that the server
        does not read, which are an error otherwise. `on_warning` is called with each thing that the map
        does not hold as the files have it; without it, the logger "covis" warns of each.
        """
        header = ImportMapHeader(
            map_id=map_id,
            policy=policy,
            format=_files.format_number(format),  # type: ignore[arg-type]
            client_id=client_id,
            skip_unknown=skip_unknown,
        )
        requests = _files.import_requests(header, Path(path))
        answer = await self._link.upload(requests, ImportMapRequest)
        for warning in answer.warnings:
            if on_warning is not None:
                on_warning(warning)
            else:
                _LOG.warning("%s: %s", path, warning.description)
        return _map_of(answer)

    async def to_pycolmap(self, map_id: str) -> Any:
        """A map as pycolmap's `Reconstruction`; needs the extra `colmap`.

        It has the points that two keyframes observe, so that pycolmap can adjust it at once.
        """
        import pycolmap

        with tempfile.TemporaryDirectory(prefix="covis-") as folder:
            await self.export_map(map_id, folder, "colmap-binary")
            return pycolmap.Reconstruction(folder)

    async def optimize(
        self,
        map_id: str,
        *,
        problem: str = "full",
        certify: bool = False,
        loss: str | None = None,
        gauge: str | None = None,
        max_iterations: int | None = None,
        time_limit_s: float | None = None,
        on_iteration: Callable[[IterationSummary], None] | None = None,
    ) -> OptimizeMapResult:
        """Optimizes a whole map. Canceling it leaves the map as it was.

        - `problem`: "full" (bundle adjustment) or "pose-graph", which judges loop closures anew.
        - `certify`: proves the optimum of the pose graph's chordal objective.
        - `loss`: of observations, such as "huber:2"; the map's by default. Refused with "pose-graph".
        - `gauge`: "first-keyframe-fixed", "free", "priors" or "fixed-poses"; the map's by default.
        - `on_iteration`: called with each iteration as it comes, on the event loop.
        """
        request = OptimizeMapRequest(
            map_id=map_id,
            problem=_problems.choice(MapProblem, "MAP_PROBLEM_", "problem", problem),  # type: ignore[arg-type]
            certify=certify,
            observation_loss=_problems.loss(loss),
            gauge=_problems.gauge(gauge),  # type: ignore[arg-type]
            options=_problems.options(max_iterations, time_limit_s),
        )
        async with aclosing(self._link.answers(request)) as events:  # type: ignore[type-var]
            async for event in events:
                if event.WhichOneof("event") == "result":
                    result: OptimizeMapResult = event.result
                    return result
                if on_iteration is not None and event.HasField("iteration"):
                    on_iteration(event.iteration)
        raise errors.Protocol("OptimizeMap: the stream ended without a result")

    async def solve_bundle(
        self,
        cameras: Sequence[Camera],
        world_from_camera: npt.ArrayLike,
        points: npt.ArrayLike,
        pose_indices: npt.ArrayLike,
        point_indices: npt.ArrayLike,
        pixels: npt.ArrayLike,
        *,
        depths: npt.ArrayLike | None = None,
        sigmas: npt.ArrayLike | None = None,
        sigma_px: npt.ArrayLike | None = None,
        camera_indices: npt.ArrayLike | None = None,
        fixed_poses: npt.ArrayLike | None = None,
        fixed_points: npt.ArrayLike | None = None,
        refine_intrinsics: bool = False,
        loss: str | None = None,
        gauge: str | None = None,
        max_iterations: int | None = None,
        time_limit_s: float | None = None,
        include_iterations: bool = False,
    ) -> BundleSolution:
        """Solves a bundle adjustment problem that fits a message; larger ones are maps.

        - `cameras`: from `covis.camera`; `camera_indices` names that of each pose (0).
        - `world_from_camera`: N×4×4, `points`: M×3, the start.
        - Row k of `pose_indices`, `point_indices` and `pixels` (px) is an observation; `depths`,
          `sigmas` and `sigma_px` are as in `Session.keyframe`.
        - `fixed_poses`, `fixed_points`: N and M booleans of what is held. By default the first pose is.
        - `loss`: such as "huber:2"; none by default.

        Raises `InvalidArgument` for a problem that cannot be solved as posed.
        """
        problem = _problems.bundle(
            cameras, world_from_camera, points, pose_indices, point_indices, pixels, depths, sigmas,
            sigma_px, camera_indices, fixed_poses, fixed_points,
        )  # fmt: skip
        request = SolveBundleRequest(
            problem=problem,
            loss=_problems.loss(loss),
            refine_intrinsics=refine_intrinsics,
            gauge=_problems.gauge(gauge),  # type: ignore[arg-type]
            options=_problems.options(max_iterations, time_limit_s),
            include_iterations=include_iterations,
        )
        return _problems.bundle_solution(await self._link.unary(request, solves=True))

    async def solve_pose_graph(
        self,
        ids: npt.ArrayLike,
        world_from_vertex: npt.ArrayLike | None,
        edges: npt.ArrayLike,
        i_from_j: npt.ArrayLike,
        information: npt.ArrayLike,
        *,
        fixed: Sequence[int] = (),
        trusted: npt.ArrayLike | None = None,
        robust: str | None = None,
        certify: bool = False,
        loss: str | None = None,
        start: str | None = None,
        max_iterations: int | None = None,
        time_limit_s: float | None = None,
        include_iterations: bool = False,
    ) -> PoseGraphSolution:
        """Solves a pose graph, in space (4×4, 6×6) or in the plane (3×3, 3×3).

        - `ids`: N vertices; `world_from_vertex`: their start, or `None`.
        - `edges`: M×2 ids (i, j); `i_from_j`: M measured poses of j in the frame of i; `information`:
          M inverse covariances, or one for all, translation first.
        - `fixed`: ids that are held; the lowest by default.
        - `robust`: "gnc-tls" or "gnc-gm" finds false loop closures, edges between ids that are not
          consecutive and not `trusted` (M booleans).
        - `start`: "vertices", "spanning-tree", "odometry", "chordal" or "auto".

        Raises `InvalidArgument` for a graph that cannot be solved as posed.
        """
        graph = _problems.graph(ids, world_from_vertex, edges, i_from_j, information, fixed, trusted)
        request = SolvePoseGraphRequest(
            loss=_problems.loss(loss),
            start=_problems.start(start),  # type: ignore[arg-type]
            robust=_problems.robustness(robust),
            certify=certify,
            options=_problems.options(max_iterations, time_limit_s),
            include_iterations=include_iterations,
        )
        kind = "se3" if type(graph).__name__ == "PoseGraphSe3" else "se2"
        getattr(request, kind).CopyFrom(graph)
        return _problems.graph_solution(await self._link.unary(request, solves=True))

    async def refine_pose(
        self,
        camera: Camera,
        world_from_camera: npt.ArrayLike,
        points: npt.ArrayLike,
        pixels: npt.ArrayLike,
        depths: npt.ArrayLike | None = None,
        sigmas: npt.ArrayLike | None = None,
        *,
        sigma_px: npt.ArrayLike | None = None,
        loss: str | None = None,
        max_iterations: int | None = None,
        include_information: bool = False,
    ) -> RefinedPose:
        """Refines the pose of one camera over known points (motion-only), in milliseconds; no map is involved.

        - `camera`: from `covis.camera`. `world_from_camera`: 4×4, the start.
        - `points`: N×3, world frame, m, at least 3. Row k of `pixels`, N×2, px, is where point k is seen;
          `depths`, `sigmas` and `sigma_px` are as in `Session.keyframe`.
        - `loss`: such as "huber:2", the default.
        - `include_information`: the information matrix of the pose.

        Raises `InvalidArgument` for a pose that cannot be refined as posed.
        """
        request = _problems.refine_request(
            camera, world_from_camera, points, pixels, depths, sigmas, sigma_px
        )
        chosen = _problems.loss(loss)
        if chosen is not None:
            request.loss.CopyFrom(chosen)
        request.options.CopyFrom(_problems.options(max_iterations, None))
        request.include_information = include_information
        return _problems.refined(await self._link.unary(request, solves=True))

    async def localize(
        self,
        map_id: str,
        camera: Camera,
        pixels: npt.ArrayLike,
        descriptors: npt.ArrayLike,
        depths: npt.ArrayLike | None = None,
        sigmas: npt.ArrayLike | None = None,
        *,
        sigma_px: npt.ArrayLike | None = None,
        descriptor_name: str = "",
        descriptor_kind: str | None = None,
    ) -> Localization | None:
        """Finds where a camera is in a map by what it sees; `None` where no place is recognized, or where
        two that contradict each other are recognized equally well.

        A `descriptor_name` that no keyframe of the map has is refused with the names that there are.
        `camera` is from `covis.camera`, the arrays are as in `Session.keyframe`. Descriptors must be binary.
        """
        request = _problems.localize_request(
            map_id, camera, pixels, descriptors, depths, sigmas, sigma_px, descriptor_name,
            descriptor_kind,
        )  # fmt: skip
        return _problems.localization(await self._link.unary(request, solves=True))

    async def create_job(self, job_id: str, spec: JobSpec, priority: int = 0) -> Job:
        """Begins work that outlives the call. The same id with the same spec is the job that is there.

        Of the jobs that wait, the one with the highest priority (-100 to 100) begins first.
        """
        request = CreateJobRequest(job_id=job_id, spec=spec, priority=priority)
        return _job_of(await self._link.unary(request))

    async def upload_job_files(self, path: str | os.PathLike[str]) -> str:
        """Uploads a file, or all files below a folder, and returns the `upload_id` for a spec."""
        requests = _files.upload_requests(Path(path))
        answer = await self._link.upload(requests, UploadJobFilesRequest)
        upload_id: str = answer.upload_id
        return upload_id

    async def download_job_files(
        self, job_id: str, folder: str | os.PathLike[str], path: str = ""
    ) -> list[Path]:
        """Writes the files that a job made, or the one of this path, into `folder`; their paths."""
        request = DownloadJobFilesRequest(job_id=job_id, path=path)
        async with aclosing(self._link.answers(request)) as answers:  # type: ignore[type-var]
            return await _files.write("DownloadJobFiles", answers, Path(folder))

    async def get_job(self, job_id: str) -> Job:
        """One job. Raises `NotFound`."""
        return _job_of(await self._link.unary(GetJobRequest(job_id=job_id)))

    async def list_jobs(
        self, map_id: str | None = None, states: Sequence[JobState] = ()
    ) -> list[Job]:
        """The jobs, the newest first; only those on a map, and in these states, where given."""
        jobs: list[Job] = []
        token = ""
        while True:
            request = ListJobsRequest(page_token=token, map_id=map_id or "", states=states)
            page = await self._link.unary(request)
            jobs += page.jobs
            if not (token := page.next_page_token):
                return jobs

    async def cancel_job(self, job_id: str) -> Job:
        """Asks a job to stop; it often still runs in the answer."""
        return _job_of(await self._link.unary(CancelJobRequest(job_id=job_id)))

    async def delete_job(self, job_id: str) -> None:
        """Forgets a job that has ended."""
        await self._link.unary(DeleteJobRequest(job_id=job_id))

    async def watch_job(self, job_id: str, retry: RetryPolicy = RetryPolicy()) -> AsyncIterator[Job]:
        """The job as it is, then as it changes, until it has ended. Goes on over broken links."""
        retries = Retries(retry)
        while True:
            try:
                request = WatchJobRequest(job_id=job_id)
                async with aclosing(self._link.answers(request)) as answers:  # type: ignore[type-var]
                    async for answer in answers:
                        retries.progress()
                        yield answer.job
                        if answer.job.state in _ENDED:
                            return
                raise errors.broken("WatchJob", "the stream ended")
            except errors.CovisError as error:
                await retries.wait(error)

    async def wait_job(self, job_id: str, retry: RetryPolicy = RetryPolicy()) -> Job:
        """Waits until a job has ended. Raises `JobFailed` where it failed."""
        async with aclosing(self.watch_job(job_id, retry)) as jobs:  # type: ignore[type-var]
            async for job in jobs:
                if job.state == JobState.JOB_STATE_FAILED:
                    raise errors.JobFailed(job)
                if job.state in _ENDED:
                    return job
        raise errors.Protocol("WatchJob: the stream ended before the job")


def _map_of(answer: Any) -> MapInfo:
    found: MapInfo = answer.map
    return found


def _job_of(answer: Any) -> Job:
    found: Job = answer.job
    return found
