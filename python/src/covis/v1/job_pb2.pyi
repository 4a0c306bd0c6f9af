import datetime

from covis.v1 import map_pb2 as _map_pb2
from covis.v1 import map_service_pb2 as _map_service_pb2
from covis.v1 import optimization_pb2 as _optimization_pb2
from covis.v1 import optimization_service_pb2 as _optimization_service_pb2
from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class JobState(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    JOB_STATE_UNSPECIFIED: _ClassVar[JobState]
    JOB_STATE_PENDING: _ClassVar[JobState]
    JOB_STATE_RUNNING: _ClassVar[JobState]
    JOB_STATE_SUCCEEDED: _ClassVar[JobState]
    JOB_STATE_FAILED: _ClassVar[JobState]
    JOB_STATE_CANCELLED: _ClassVar[JobState]

class ProblemFileKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    PROBLEM_FILE_KIND_UNSPECIFIED: _ClassVar[ProblemFileKind]
    PROBLEM_FILE_KIND_BUNDLE: _ClassVar[ProblemFileKind]
    PROBLEM_FILE_KIND_POSE_GRAPH: _ClassVar[ProblemFileKind]

class LengthUnit(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    LENGTH_UNIT_UNSPECIFIED: _ClassVar[LengthUnit]
    LENGTH_UNIT_DEPTH: _ClassVar[LengthUnit]
    LENGTH_UNIT_RELATIVE_POSES: _ClassVar[LengthUnit]
    LENGTH_UNIT_GIVEN: _ClassVar[LengthUnit]
    LENGTH_UNIT_CONVENTION: _ClassVar[LengthUnit]
JOB_STATE_UNSPECIFIED: JobState
JOB_STATE_PENDING: JobState
JOB_STATE_RUNNING: JobState
JOB_STATE_SUCCEEDED: JobState
JOB_STATE_FAILED: JobState
JOB_STATE_CANCELLED: JobState
PROBLEM_FILE_KIND_UNSPECIFIED: ProblemFileKind
PROBLEM_FILE_KIND_BUNDLE: ProblemFileKind
PROBLEM_FILE_KIND_POSE_GRAPH: ProblemFileKind
LENGTH_UNIT_UNSPECIFIED: LengthUnit
LENGTH_UNIT_DEPTH: LengthUnit
LENGTH_UNIT_RELATIVE_POSES: LengthUnit
LENGTH_UNIT_GIVEN: LengthUnit
LENGTH_UNIT_CONVENTION: LengthUnit

class Job(_message.Message):
    __slots__ = ("job_id", "spec", "state", "progress", "failure", "result", "create_time", "start_time", "end_time", "expire_time", "cancel_requested", "priority", "files", "attempt_count", "cost_before", "cost_after", "shortened_lists")
    JOB_ID_FIELD_NUMBER: _ClassVar[int]
    SPEC_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    PROGRESS_FIELD_NUMBER: _ClassVar[int]
    FAILURE_FIELD_NUMBER: _ClassVar[int]
    RESULT_FIELD_NUMBER: _ClassVar[int]
    CREATE_TIME_FIELD_NUMBER: _ClassVar[int]
    START_TIME_FIELD_NUMBER: _ClassVar[int]
    END_TIME_FIELD_NUMBER: _ClassVar[int]
    EXPIRE_TIME_FIELD_NUMBER: _ClassVar[int]
    CANCEL_REQUESTED_FIELD_NUMBER: _ClassVar[int]
    PRIORITY_FIELD_NUMBER: _ClassVar[int]
    FILES_FIELD_NUMBER: _ClassVar[int]
    ATTEMPT_COUNT_FIELD_NUMBER: _ClassVar[int]
    COST_BEFORE_FIELD_NUMBER: _ClassVar[int]
    COST_AFTER_FIELD_NUMBER: _ClassVar[int]
    SHORTENED_LISTS_FIELD_NUMBER: _ClassVar[int]
    job_id: str
    spec: JobSpec
    state: JobState
    progress: JobProgress
    failure: JobFailure
    result: JobResult
    create_time: _timestamp_pb2.Timestamp
    start_time: _timestamp_pb2.Timestamp
    end_time: _timestamp_pb2.Timestamp
    expire_time: _timestamp_pb2.Timestamp
    cancel_requested: bool
    priority: int
    files: _containers.RepeatedCompositeFieldContainer[JobFile]
    attempt_count: int
    cost_before: float
    cost_after: float
    shortened_lists: _containers.RepeatedCompositeFieldContainer[ShortenedList]
    def __init__(self, job_id: _Optional[str] = ..., spec: _Optional[_Union[JobSpec, _Mapping]] = ..., state: _Optional[_Union[JobState, str]] = ..., progress: _Optional[_Union[JobProgress, _Mapping]] = ..., failure: _Optional[_Union[JobFailure, _Mapping]] = ..., result: _Optional[_Union[JobResult, _Mapping]] = ..., create_time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., start_time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., end_time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., expire_time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., cancel_requested: bool = ..., priority: _Optional[int] = ..., files: _Optional[_Iterable[_Union[JobFile, _Mapping]]] = ..., attempt_count: _Optional[int] = ..., cost_before: _Optional[float] = ..., cost_after: _Optional[float] = ..., shortened_lists: _Optional[_Iterable[_Union[ShortenedList, _Mapping]]] = ...) -> None: ...

class ShortenedList(_message.Message):
    __slots__ = ("field_path", "entry_count", "file_path")
    FIELD_PATH_FIELD_NUMBER: _ClassVar[int]
    ENTRY_COUNT_FIELD_NUMBER: _ClassVar[int]
    FILE_PATH_FIELD_NUMBER: _ClassVar[int]
    field_path: str
    entry_count: int
    file_path: str
    def __init__(self, field_path: _Optional[str] = ..., entry_count: _Optional[int] = ..., file_path: _Optional[str] = ...) -> None: ...

class JobFile(_message.Message):
    __slots__ = ("path", "size_bytes")
    PATH_FIELD_NUMBER: _ClassVar[int]
    SIZE_BYTES_FIELD_NUMBER: _ClassVar[int]
    path: str
    size_bytes: int
    def __init__(self, path: _Optional[str] = ..., size_bytes: _Optional[int] = ...) -> None: ...

class JobSpec(_message.Message):
    __slots__ = ("optimize_map", "merge_maps", "rebuild_map", "compact_map", "evaluate_trajectory", "export_map", "solve_files", "reconstruct")
    OPTIMIZE_MAP_FIELD_NUMBER: _ClassVar[int]
    MERGE_MAPS_FIELD_NUMBER: _ClassVar[int]
    REBUILD_MAP_FIELD_NUMBER: _ClassVar[int]
    COMPACT_MAP_FIELD_NUMBER: _ClassVar[int]
    EVALUATE_TRAJECTORY_FIELD_NUMBER: _ClassVar[int]
    EXPORT_MAP_FIELD_NUMBER: _ClassVar[int]
    SOLVE_FILES_FIELD_NUMBER: _ClassVar[int]
    RECONSTRUCT_FIELD_NUMBER: _ClassVar[int]
    optimize_map: _optimization_service_pb2.OptimizeMapRequest
    merge_maps: _map_service_pb2.MergeMapsRequest
    rebuild_map: RebuildMapSpec
    compact_map: CompactMapSpec
    evaluate_trajectory: EvaluateTrajectorySpec
    export_map: _map_service_pb2.ExportMapRequest
    solve_files: SolveFilesSpec
    reconstruct: ReconstructSpec
    def __init__(self, optimize_map: _Optional[_Union[_optimization_service_pb2.OptimizeMapRequest, _Mapping]] = ..., merge_maps: _Optional[_Union[_map_service_pb2.MergeMapsRequest, _Mapping]] = ..., rebuild_map: _Optional[_Union[RebuildMapSpec, _Mapping]] = ..., compact_map: _Optional[_Union[CompactMapSpec, _Mapping]] = ..., evaluate_trajectory: _Optional[_Union[EvaluateTrajectorySpec, _Mapping]] = ..., export_map: _Optional[_Union[_map_service_pb2.ExportMapRequest, _Mapping]] = ..., solve_files: _Optional[_Union[SolveFilesSpec, _Mapping]] = ..., reconstruct: _Optional[_Union[ReconstructSpec, _Mapping]] = ...) -> None: ...

class SolveFilesSpec(_message.Message):
    __slots__ = ("upload_id", "kind", "keep_solutions")
    UPLOAD_ID_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    KEEP_SOLUTIONS_FIELD_NUMBER: _ClassVar[int]
    upload_id: str
    kind: ProblemFileKind
    keep_solutions: bool
    def __init__(self, upload_id: _Optional[str] = ..., kind: _Optional[_Union[ProblemFileKind, str]] = ..., keep_solutions: bool = ...) -> None: ...

class ReconstructSpec(_message.Message):
    __slots__ = ("map_id", "upload_id", "keep_solutions")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    UPLOAD_ID_FIELD_NUMBER: _ClassVar[int]
    KEEP_SOLUTIONS_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    upload_id: str
    keep_solutions: bool
    def __init__(self, map_id: _Optional[str] = ..., upload_id: _Optional[str] = ..., keep_solutions: bool = ...) -> None: ...

class RebuildMapSpec(_message.Message):
    __slots__ = ("source_map_id", "target_map_id", "policy")
    SOURCE_MAP_ID_FIELD_NUMBER: _ClassVar[int]
    TARGET_MAP_ID_FIELD_NUMBER: _ClassVar[int]
    POLICY_FIELD_NUMBER: _ClassVar[int]
    source_map_id: str
    target_map_id: str
    policy: _map_pb2.MapPolicy
    def __init__(self, source_map_id: _Optional[str] = ..., target_map_id: _Optional[str] = ..., policy: _Optional[_Union[_map_pb2.MapPolicy, _Mapping]] = ...) -> None: ...

class CompactMapSpec(_message.Message):
    __slots__ = ("map_id", "redundant_share", "drop_old_journal")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    REDUNDANT_SHARE_FIELD_NUMBER: _ClassVar[int]
    DROP_OLD_JOURNAL_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    redundant_share: float
    drop_old_journal: bool
    def __init__(self, map_id: _Optional[str] = ..., redundant_share: _Optional[float] = ..., drop_old_journal: bool = ...) -> None: ...

class EvaluateTrajectorySpec(_message.Message):
    __slots__ = ("map_id", "client_id", "truth", "max_time_difference_s", "truth_upload_id")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    TRUTH_FIELD_NUMBER: _ClassVar[int]
    MAX_TIME_DIFFERENCE_S_FIELD_NUMBER: _ClassVar[int]
    TRUTH_UPLOAD_ID_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    client_id: str
    truth: _containers.RepeatedCompositeFieldContainer[_map_service_pb2.KeyframePose]
    max_time_difference_s: float
    truth_upload_id: str
    def __init__(self, map_id: _Optional[str] = ..., client_id: _Optional[str] = ..., truth: _Optional[_Iterable[_Union[_map_service_pb2.KeyframePose, _Mapping]]] = ..., max_time_difference_s: _Optional[float] = ..., truth_upload_id: _Optional[str] = ...) -> None: ...

class JobProgress(_message.Message):
    __slots__ = ("phase", "share", "iteration", "update_time", "time_left_s")
    PHASE_FIELD_NUMBER: _ClassVar[int]
    SHARE_FIELD_NUMBER: _ClassVar[int]
    ITERATION_FIELD_NUMBER: _ClassVar[int]
    UPDATE_TIME_FIELD_NUMBER: _ClassVar[int]
    TIME_LEFT_S_FIELD_NUMBER: _ClassVar[int]
    phase: str
    share: float
    iteration: _optimization_pb2.IterationSummary
    update_time: _timestamp_pb2.Timestamp
    time_left_s: float
    def __init__(self, phase: _Optional[str] = ..., share: _Optional[float] = ..., iteration: _Optional[_Union[_optimization_pb2.IterationSummary, _Mapping]] = ..., update_time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., time_left_s: _Optional[float] = ...) -> None: ...

class JobFailure(_message.Message):
    __slots__ = ("code", "message", "reason")
    CODE_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    code: int
    message: str
    reason: str
    def __init__(self, code: _Optional[int] = ..., message: _Optional[str] = ..., reason: _Optional[str] = ...) -> None: ...

class JobResult(_message.Message):
    __slots__ = ("optimize_map", "merge_maps", "rebuild_map", "compact_map", "evaluate_trajectory", "export_map", "solve_files", "reconstruct")
    OPTIMIZE_MAP_FIELD_NUMBER: _ClassVar[int]
    MERGE_MAPS_FIELD_NUMBER: _ClassVar[int]
    REBUILD_MAP_FIELD_NUMBER: _ClassVar[int]
    COMPACT_MAP_FIELD_NUMBER: _ClassVar[int]
    EVALUATE_TRAJECTORY_FIELD_NUMBER: _ClassVar[int]
    EXPORT_MAP_FIELD_NUMBER: _ClassVar[int]
    SOLVE_FILES_FIELD_NUMBER: _ClassVar[int]
    RECONSTRUCT_FIELD_NUMBER: _ClassVar[int]
    optimize_map: _optimization_service_pb2.OptimizeMapResult
    merge_maps: _map_service_pb2.MergeMapsResponse
    rebuild_map: RebuildMapResult
    compact_map: CompactMapResult
    evaluate_trajectory: EvaluateTrajectoryResult
    export_map: ExportMapResult
    solve_files: SolveFilesResult
    reconstruct: ReconstructResult
    def __init__(self, optimize_map: _Optional[_Union[_optimization_service_pb2.OptimizeMapResult, _Mapping]] = ..., merge_maps: _Optional[_Union[_map_service_pb2.MergeMapsResponse, _Mapping]] = ..., rebuild_map: _Optional[_Union[RebuildMapResult, _Mapping]] = ..., compact_map: _Optional[_Union[CompactMapResult, _Mapping]] = ..., evaluate_trajectory: _Optional[_Union[EvaluateTrajectoryResult, _Mapping]] = ..., export_map: _Optional[_Union[ExportMapResult, _Mapping]] = ..., solve_files: _Optional[_Union[SolveFilesResult, _Mapping]] = ..., reconstruct: _Optional[_Union[ReconstructResult, _Mapping]] = ...) -> None: ...

class ExportMapResult(_message.Message):
    __slots__ = ("revision",)
    REVISION_FIELD_NUMBER: _ClassVar[int]
    revision: int
    def __init__(self, revision: _Optional[int] = ...) -> None: ...

class SolveFilesResult(_message.Message):
    __slots__ = ("problems",)
    PROBLEMS_FIELD_NUMBER: _ClassVar[int]
    problems: _containers.RepeatedCompositeFieldContainer[SolvedProblem]
    def __init__(self, problems: _Optional[_Iterable[_Union[SolvedProblem, _Mapping]]] = ...) -> None: ...

class SolvedProblem(_message.Message):
    __slots__ = ("path", "summary", "reconstruction")
    PATH_FIELD_NUMBER: _ClassVar[int]
    SUMMARY_FIELD_NUMBER: _ClassVar[int]
    RECONSTRUCTION_FIELD_NUMBER: _ClassVar[int]
    path: str
    summary: _optimization_pb2.SolveSummary
    reconstruction: Reconstruction
    def __init__(self, path: _Optional[str] = ..., summary: _Optional[_Union[_optimization_pb2.SolveSummary, _Mapping]] = ..., reconstruction: _Optional[_Union[Reconstruction, _Mapping]] = ...) -> None: ...

class ReconstructResult(_message.Message):
    __slots__ = ("revision", "summary", "reconstruction", "problems")
    REVISION_FIELD_NUMBER: _ClassVar[int]
    SUMMARY_FIELD_NUMBER: _ClassVar[int]
    RECONSTRUCTION_FIELD_NUMBER: _ClassVar[int]
    PROBLEMS_FIELD_NUMBER: _ClassVar[int]
    revision: int
    summary: _optimization_pb2.SolveSummary
    reconstruction: Reconstruction
    problems: _containers.RepeatedCompositeFieldContainer[SolvedProblem]
    def __init__(self, revision: _Optional[int] = ..., summary: _Optional[_Union[_optimization_pb2.SolveSummary, _Mapping]] = ..., reconstruction: _Optional[_Union[Reconstruction, _Mapping]] = ..., problems: _Optional[_Iterable[_Union[SolvedProblem, _Mapping]]] = ...) -> None: ...

class Reconstruction(_message.Message):
    __slots__ = ("keyframe_count", "placed_keyframe_count", "landmark_count", "placed_landmark_count", "observation_count", "agreeing_observation_count", "pair_count", "measured_pair_count", "relative_pose_count", "length_unit", "unplaced_keyframes")
    KEYFRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    PLACED_KEYFRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    LANDMARK_COUNT_FIELD_NUMBER: _ClassVar[int]
    PLACED_LANDMARK_COUNT_FIELD_NUMBER: _ClassVar[int]
    OBSERVATION_COUNT_FIELD_NUMBER: _ClassVar[int]
    AGREEING_OBSERVATION_COUNT_FIELD_NUMBER: _ClassVar[int]
    PAIR_COUNT_FIELD_NUMBER: _ClassVar[int]
    MEASURED_PAIR_COUNT_FIELD_NUMBER: _ClassVar[int]
    RELATIVE_POSE_COUNT_FIELD_NUMBER: _ClassVar[int]
    LENGTH_UNIT_FIELD_NUMBER: _ClassVar[int]
    UNPLACED_KEYFRAMES_FIELD_NUMBER: _ClassVar[int]
    keyframe_count: int
    placed_keyframe_count: int
    landmark_count: int
    placed_landmark_count: int
    observation_count: int
    agreeing_observation_count: int
    pair_count: int
    measured_pair_count: int
    relative_pose_count: int
    length_unit: LengthUnit
    unplaced_keyframes: _containers.RepeatedCompositeFieldContainer[UnplacedKeyframe]
    def __init__(self, keyframe_count: _Optional[int] = ..., placed_keyframe_count: _Optional[int] = ..., landmark_count: _Optional[int] = ..., placed_landmark_count: _Optional[int] = ..., observation_count: _Optional[int] = ..., agreeing_observation_count: _Optional[int] = ..., pair_count: _Optional[int] = ..., measured_pair_count: _Optional[int] = ..., relative_pose_count: _Optional[int] = ..., length_unit: _Optional[_Union[LengthUnit, str]] = ..., unplaced_keyframes: _Optional[_Iterable[_Union[UnplacedKeyframe, _Mapping]]] = ...) -> None: ...

class UnplacedKeyframe(_message.Message):
    __slots__ = ("client_id", "id", "reason")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    id: int
    reason: str
    def __init__(self, client_id: _Optional[str] = ..., id: _Optional[int] = ..., reason: _Optional[str] = ...) -> None: ...

class RebuildMapResult(_message.Message):
    __slots__ = ("map",)
    MAP_FIELD_NUMBER: _ClassVar[int]
    map: _map_pb2.Map
    def __init__(self, map: _Optional[_Union[_map_pb2.Map, _Mapping]] = ...) -> None: ...

class CompactMapResult(_message.Message):
    __slots__ = ("counts_before", "counts_after", "retired_keyframe_count")
    COUNTS_BEFORE_FIELD_NUMBER: _ClassVar[int]
    COUNTS_AFTER_FIELD_NUMBER: _ClassVar[int]
    RETIRED_KEYFRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    counts_before: _map_pb2.MapCounts
    counts_after: _map_pb2.MapCounts
    retired_keyframe_count: int
    def __init__(self, counts_before: _Optional[_Union[_map_pb2.MapCounts, _Mapping]] = ..., counts_after: _Optional[_Union[_map_pb2.MapCounts, _Mapping]] = ..., retired_keyframe_count: _Optional[int] = ...) -> None: ...

class EvaluateTrajectoryResult(_message.Message):
    __slots__ = ("matched_pose_count", "absolute_translation_rmse_m", "relative_translation_rmse_m", "relative_rotation_rmse_rad")
    MATCHED_POSE_COUNT_FIELD_NUMBER: _ClassVar[int]
    ABSOLUTE_TRANSLATION_RMSE_M_FIELD_NUMBER: _ClassVar[int]
    RELATIVE_TRANSLATION_RMSE_M_FIELD_NUMBER: _ClassVar[int]
    RELATIVE_ROTATION_RMSE_RAD_FIELD_NUMBER: _ClassVar[int]
    matched_pose_count: int
    absolute_translation_rmse_m: float
    relative_translation_rmse_m: float
    relative_rotation_rmse_rad: float
    def __init__(self, matched_pose_count: _Optional[int] = ..., absolute_translation_rmse_m: _Optional[float] = ..., relative_translation_rmse_m: _Optional[float] = ..., relative_rotation_rmse_rad: _Optional[float] = ...) -> None: ...
