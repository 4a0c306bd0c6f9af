"""covis from Python: send keyframes, follow the corrected map, solve on request.

```
import covis

with covis.connect("http://127.0.0.1:7411") as client:
    with client.ingest("map", "robot") as session:
        session.camera(0, 640, 480, K)
        session.keyframe(0, t, world_from_camera, pixels, landmark_ids, depths)
        session.wait_optimized()
    poses = client.watch("map").poses
```

Blocking classes are here, their asyncio twins in `covis.aio`, messages of the wire in `covis.v1`.
Conventions (frames, units, the order of matrices) are those of docs/conventions.md.
"""

from importlib.metadata import version as _version

from . import aio, v1
from ._connect import camera
from ._link import LinkOptions
from ._maps import MapDigests
from ._mirror import Closure, MapChanges
from ._poses import join_pose, split_pose
from ._problems import BundleSolution, Localization, PoseGraphSolution, RefinedPose
from ._retry import RetryPolicy
from ._stream import IngestReport
from ._sync import Client, Map, Session, connect, local
from .errors import (
    AlreadyExists,
    Closed,
    CovisError,
    DeadlineExceeded,
    FailedPrecondition,
    Fenced,
    InvalidArgument,
    InvalidToken,
    InvalidUrl,
    ItemsLost,
    JobFailed,
    MapNotOpen,
    MapReplaced,
    NotDurable,
    NotFound,
    PermissionDenied,
    Protocol,
    Rejected,
    RejectedItem,
    ResourceExhausted,
    RetriesExhausted,
    RpcError,
    SequenceOrder,
    ServerFailed,
    ServerRestarted,
    TokenInPlainText,
    TooLarge,
    Unauthenticated,
    Unreachable,
    Violation,
)
from .noise import (
    closure_information,
    kinect_sigma_m,
    pack_symmetric,
    position_information,
    stereo_sigma_m,
    unpack_symmetric,
)
from .trajectory import Trajectory

__version__ = _version("covis")

__all__ = [
    "__version__",
    "aio",
    "AlreadyExists",
    "BundleSolution",
    "camera",
    "Client",
    "Closed",
    "Closure",
    "closure_information",
    "connect",
    "CovisError",
    "DeadlineExceeded",
    "FailedPrecondition",
    "Fenced",
    "IngestReport",
    "InvalidArgument",
    "InvalidToken",
    "InvalidUrl",
    "ItemsLost",
    "JobFailed",
    "join_pose",
    "kinect_sigma_m",
    "LinkOptions",
    "local",
    "Localization",
    "Map",
    "MapChanges",
    "MapDigests",
    "MapNotOpen",
    "MapReplaced",
    "NotDurable",
    "NotFound",
    "pack_symmetric",
    "PermissionDenied",
    "PoseGraphSolution",
    "position_information",
    "Protocol",
    "RefinedPose",
    "Rejected",
    "RejectedItem",
    "ResourceExhausted",
    "RetriesExhausted",
    "RetryPolicy",
    "RpcError",
    "SequenceOrder",
    "ServerFailed",
    "ServerRestarted",
    "Session",
    "split_pose",
    "stereo_sigma_m",
    "TokenInPlainText",
    "TooLarge",
    "Trajectory",
    "Unauthenticated",
    "unpack_symmetric",
    "Unreachable",
    "v1",
    "Violation",
]
