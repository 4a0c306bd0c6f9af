from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class LossKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    LOSS_KIND_UNSPECIFIED: _ClassVar[LossKind]
    LOSS_KIND_TRIVIAL: _ClassVar[LossKind]
    LOSS_KIND_HUBER: _ClassVar[LossKind]
    LOSS_KIND_CAUCHY: _ClassVar[LossKind]
    LOSS_KIND_TUKEY: _ClassVar[LossKind]
    LOSS_KIND_GEMAN_MCCLURE: _ClassVar[LossKind]

class Gauge(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    GAUGE_UNSPECIFIED: _ClassVar[Gauge]
    GAUGE_FIRST_KEYFRAME_FIXED: _ClassVar[Gauge]
    GAUGE_FREE: _ClassVar[Gauge]
    GAUGE_PRIORS: _ClassVar[Gauge]
    GAUGE_FIXED_POSES: _ClassVar[Gauge]

class SolverMethod(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    SOLVER_METHOD_UNSPECIFIED: _ClassVar[SolverMethod]
    SOLVER_METHOD_LEVENBERG_MARQUARDT: _ClassVar[SolverMethod]
    SOLVER_METHOD_GAUSS_NEWTON: _ClassVar[SolverMethod]

class LinearSolver(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    LINEAR_SOLVER_UNSPECIFIED: _ClassVar[LinearSolver]
    LINEAR_SOLVER_AUTO: _ClassVar[LinearSolver]
    LINEAR_SOLVER_DENSE_SCHUR: _ClassVar[LinearSolver]
    LINEAR_SOLVER_SPARSE_SCHUR: _ClassVar[LinearSolver]
    LINEAR_SOLVER_SPARSE_CHOLESKY: _ClassVar[LinearSolver]
    LINEAR_SOLVER_DENSE_CHOLESKY: _ClassVar[LinearSolver]
    LINEAR_SOLVER_ITERATIVE_SCHUR: _ClassVar[LinearSolver]

class RobustKernel(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ROBUST_KERNEL_UNSPECIFIED: _ClassVar[RobustKernel]
    ROBUST_KERNEL_NONE: _ClassVar[RobustKernel]
    ROBUST_KERNEL_GNC_TLS: _ClassVar[RobustKernel]
    ROBUST_KERNEL_GNC_GM: _ClassVar[RobustKernel]

class Termination(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    TERMINATION_UNSPECIFIED: _ClassVar[Termination]
    TERMINATION_CONVERGED_FUNCTION: _ClassVar[Termination]
    TERMINATION_CONVERGED_GRADIENT: _ClassVar[Termination]
    TERMINATION_CONVERGED_PARAMETER: _ClassVar[Termination]
    TERMINATION_MAX_ITERATIONS: _ClassVar[Termination]
    TERMINATION_DEADLINE: _ClassVar[Termination]
    TERMINATION_CANCELLED: _ClassVar[Termination]
    TERMINATION_STALLED: _ClassVar[Termination]
    TERMINATION_NUMERICAL_FAILURE: _ClassVar[Termination]

class FactorKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FACTOR_KIND_UNSPECIFIED: _ClassVar[FactorKind]
    FACTOR_KIND_REPROJECTION: _ClassVar[FactorKind]
    FACTOR_KIND_DEPTH_REPROJECTION: _ClassVar[FactorKind]
    FACTOR_KIND_RELATIVE_POSE: _ClassVar[FactorKind]
    FACTOR_KIND_POSE_PRIOR: _ClassVar[FactorKind]
    FACTOR_KIND_POSITION_PRIOR: _ClassVar[FactorKind]
    FACTOR_KIND_LINEAR_PRIOR: _ClassVar[FactorKind]
    FACTOR_KIND_LANDMARK: _ClassVar[FactorKind]

class ResidualKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    RESIDUAL_KIND_UNSPECIFIED: _ClassVar[ResidualKind]
    RESIDUAL_KIND_PIXEL: _ClassVar[ResidualKind]
    RESIDUAL_KIND_DEPTH: _ClassVar[ResidualKind]
    RESIDUAL_KIND_RELATIVE_TRANSLATION: _ClassVar[ResidualKind]
    RESIDUAL_KIND_RELATIVE_ROTATION: _ClassVar[ResidualKind]
    RESIDUAL_KIND_PRIOR_TRANSLATION: _ClassVar[ResidualKind]
    RESIDUAL_KIND_PRIOR_ROTATION: _ClassVar[ResidualKind]
    RESIDUAL_KIND_PRIOR_POSITION: _ClassVar[ResidualKind]
    RESIDUAL_KIND_LANDMARK_POSITION: _ClassVar[ResidualKind]
    RESIDUAL_KIND_LANDMARK_BEARING: _ClassVar[ResidualKind]
    RESIDUAL_KIND_LANDMARK_RANGE: _ClassVar[ResidualKind]

class SigmaJudgment(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    SIGMA_JUDGMENT_UNSPECIFIED: _ClassVar[SigmaJudgment]
    SIGMA_JUDGMENT_PLAUSIBLE: _ClassVar[SigmaJudgment]
    SIGMA_JUDGMENT_TOO_SMALL: _ClassVar[SigmaJudgment]
    SIGMA_JUDGMENT_TOO_LARGE: _ClassVar[SigmaJudgment]

class HoldReason(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    HOLD_REASON_UNSPECIFIED: _ClassVar[HoldReason]
    HOLD_REASON_UNMEASURED: _ClassVar[HoldReason]
    HOLD_REASON_BEHIND: _ClassVar[HoldReason]
    HOLD_REASON_WORSE: _ClassVar[HoldReason]
    HOLD_REASON_UNDETERMINED: _ClassVar[HoldReason]
    HOLD_REASON_SCALE: _ClassVar[HoldReason]
LOSS_KIND_UNSPECIFIED: LossKind
LOSS_KIND_TRIVIAL: LossKind
LOSS_KIND_HUBER: LossKind
LOSS_KIND_CAUCHY: LossKind
LOSS_KIND_TUKEY: LossKind
LOSS_KIND_GEMAN_MCCLURE: LossKind
GAUGE_UNSPECIFIED: Gauge
GAUGE_FIRST_KEYFRAME_FIXED: Gauge
GAUGE_FREE: Gauge
GAUGE_PRIORS: Gauge
GAUGE_FIXED_POSES: Gauge
SOLVER_METHOD_UNSPECIFIED: SolverMethod
SOLVER_METHOD_LEVENBERG_MARQUARDT: SolverMethod
SOLVER_METHOD_GAUSS_NEWTON: SolverMethod
LINEAR_SOLVER_UNSPECIFIED: LinearSolver
LINEAR_SOLVER_AUTO: LinearSolver
LINEAR_SOLVER_DENSE_SCHUR: LinearSolver
LINEAR_SOLVER_SPARSE_SCHUR: LinearSolver
LINEAR_SOLVER_SPARSE_CHOLESKY: LinearSolver
LINEAR_SOLVER_DENSE_CHOLESKY: LinearSolver
LINEAR_SOLVER_ITERATIVE_SCHUR: LinearSolver
ROBUST_KERNEL_UNSPECIFIED: RobustKernel
ROBUST_KERNEL_NONE: RobustKernel
ROBUST_KERNEL_GNC_TLS: RobustKernel
ROBUST_KERNEL_GNC_GM: RobustKernel
TERMINATION_UNSPECIFIED: Termination
TERMINATION_CONVERGED_FUNCTION: Termination
TERMINATION_CONVERGED_GRADIENT: Termination
TERMINATION_CONVERGED_PARAMETER: Termination
TERMINATION_MAX_ITERATIONS: Termination
TERMINATION_DEADLINE: Termination
TERMINATION_CANCELLED: Termination
TERMINATION_STALLED: Termination
TERMINATION_NUMERICAL_FAILURE: Termination
FACTOR_KIND_UNSPECIFIED: FactorKind
FACTOR_KIND_REPROJECTION: FactorKind
FACTOR_KIND_DEPTH_REPROJECTION: FactorKind
FACTOR_KIND_RELATIVE_POSE: FactorKind
FACTOR_KIND_POSE_PRIOR: FactorKind
FACTOR_KIND_POSITION_PRIOR: FactorKind
FACTOR_KIND_LINEAR_PRIOR: FactorKind
FACTOR_KIND_LANDMARK: FactorKind
RESIDUAL_KIND_UNSPECIFIED: ResidualKind
RESIDUAL_KIND_PIXEL: ResidualKind
RESIDUAL_KIND_DEPTH: ResidualKind
RESIDUAL_KIND_RELATIVE_TRANSLATION: ResidualKind
RESIDUAL_KIND_RELATIVE_ROTATION: ResidualKind
RESIDUAL_KIND_PRIOR_TRANSLATION: ResidualKind
RESIDUAL_KIND_PRIOR_ROTATION: ResidualKind
RESIDUAL_KIND_PRIOR_POSITION: ResidualKind
RESIDUAL_KIND_LANDMARK_POSITION: ResidualKind
RESIDUAL_KIND_LANDMARK_BEARING: ResidualKind
RESIDUAL_KIND_LANDMARK_RANGE: ResidualKind
SIGMA_JUDGMENT_UNSPECIFIED: SigmaJudgment
SIGMA_JUDGMENT_PLAUSIBLE: SigmaJudgment
SIGMA_JUDGMENT_TOO_SMALL: SigmaJudgment
SIGMA_JUDGMENT_TOO_LARGE: SigmaJudgment
HOLD_REASON_UNSPECIFIED: HoldReason
HOLD_REASON_UNMEASURED: HoldReason
HOLD_REASON_BEHIND: HoldReason
HOLD_REASON_WORSE: HoldReason
HOLD_REASON_UNDETERMINED: HoldReason
HOLD_REASON_SCALE: HoldReason

class Loss(_message.Message):
    __slots__ = ("kind", "width")
    KIND_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    kind: LossKind
    width: float
    def __init__(self, kind: _Optional[_Union[LossKind, str]] = ..., width: _Optional[float] = ...) -> None: ...

class SolverOptions(_message.Message):
    __slots__ = ("max_iteration_count", "method", "linear_solver", "thread_count", "function_tolerance", "gradient_tolerance", "parameter_tolerance", "deadline_ms", "initial_damping")
    MAX_ITERATION_COUNT_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    LINEAR_SOLVER_FIELD_NUMBER: _ClassVar[int]
    THREAD_COUNT_FIELD_NUMBER: _ClassVar[int]
    FUNCTION_TOLERANCE_FIELD_NUMBER: _ClassVar[int]
    GRADIENT_TOLERANCE_FIELD_NUMBER: _ClassVar[int]
    PARAMETER_TOLERANCE_FIELD_NUMBER: _ClassVar[int]
    DEADLINE_MS_FIELD_NUMBER: _ClassVar[int]
    INITIAL_DAMPING_FIELD_NUMBER: _ClassVar[int]
    max_iteration_count: int
    method: SolverMethod
    linear_solver: LinearSolver
    thread_count: int
    function_tolerance: float
    gradient_tolerance: float
    parameter_tolerance: float
    deadline_ms: int
    initial_damping: float
    def __init__(self, max_iteration_count: _Optional[int] = ..., method: _Optional[_Union[SolverMethod, str]] = ..., linear_solver: _Optional[_Union[LinearSolver, str]] = ..., thread_count: _Optional[int] = ..., function_tolerance: _Optional[float] = ..., gradient_tolerance: _Optional[float] = ..., parameter_tolerance: _Optional[float] = ..., deadline_ms: _Optional[int] = ..., initial_damping: _Optional[float] = ...) -> None: ...

class ClosureRobustness(_message.Message):
    __slots__ = ("kernel", "threshold")
    KERNEL_FIELD_NUMBER: _ClassVar[int]
    THRESHOLD_FIELD_NUMBER: _ClassVar[int]
    kernel: RobustKernel
    threshold: float
    def __init__(self, kernel: _Optional[_Union[RobustKernel, str]] = ..., threshold: _Optional[float] = ...) -> None: ...

class SwitchedOff(_message.Message):
    __slots__ = ("chi2", "weight", "provisional")
    CHI2_FIELD_NUMBER: _ClassVar[int]
    WEIGHT_FIELD_NUMBER: _ClassVar[int]
    PROVISIONAL_FIELD_NUMBER: _ClassVar[int]
    chi2: float
    weight: float
    provisional: bool
    def __init__(self, chi2: _Optional[float] = ..., weight: _Optional[float] = ..., provisional: bool = ...) -> None: ...

class ClosureSummary(_message.Message):
    __slots__ = ("closure_count", "switched_off_count", "provisional_count", "variance_factors")
    CLOSURE_COUNT_FIELD_NUMBER: _ClassVar[int]
    SWITCHED_OFF_COUNT_FIELD_NUMBER: _ClassVar[int]
    PROVISIONAL_COUNT_FIELD_NUMBER: _ClassVar[int]
    VARIANCE_FACTORS_FIELD_NUMBER: _ClassVar[int]
    closure_count: int
    switched_off_count: int
    provisional_count: int
    variance_factors: _containers.RepeatedCompositeFieldContainer[VarianceFactors]
    def __init__(self, closure_count: _Optional[int] = ..., switched_off_count: _Optional[int] = ..., provisional_count: _Optional[int] = ..., variance_factors: _Optional[_Iterable[_Union[VarianceFactors, _Mapping]]] = ...) -> None: ...

class VarianceFactors(_message.Message):
    __slots__ = ("client_id", "odometry", "loop_closure")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    ODOMETRY_FIELD_NUMBER: _ClassVar[int]
    LOOP_CLOSURE_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    odometry: float
    loop_closure: float
    def __init__(self, client_id: _Optional[str] = ..., odometry: _Optional[float] = ..., loop_closure: _Optional[float] = ...) -> None: ...

class ChordalCertificate(_message.Message):
    __slots__ = ("certified", "cost", "gap", "min_eigenvalue", "lift_count", "duration_us")
    CERTIFIED_FIELD_NUMBER: _ClassVar[int]
    COST_FIELD_NUMBER: _ClassVar[int]
    GAP_FIELD_NUMBER: _ClassVar[int]
    MIN_EIGENVALUE_FIELD_NUMBER: _ClassVar[int]
    LIFT_COUNT_FIELD_NUMBER: _ClassVar[int]
    DURATION_US_FIELD_NUMBER: _ClassVar[int]
    certified: bool
    cost: float
    gap: float
    min_eigenvalue: float
    lift_count: int
    duration_us: int
    def __init__(self, certified: bool = ..., cost: _Optional[float] = ..., gap: _Optional[float] = ..., min_eigenvalue: _Optional[float] = ..., lift_count: _Optional[int] = ..., duration_us: _Optional[int] = ...) -> None: ...

class IterationSummary(_message.Message):
    __slots__ = ("iteration", "cost", "accepted", "gradient_max_norm", "step_norm", "damping", "step_quality", "elapsed_us")
    ITERATION_FIELD_NUMBER: _ClassVar[int]
    COST_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    GRADIENT_MAX_NORM_FIELD_NUMBER: _ClassVar[int]
    STEP_NORM_FIELD_NUMBER: _ClassVar[int]
    DAMPING_FIELD_NUMBER: _ClassVar[int]
    STEP_QUALITY_FIELD_NUMBER: _ClassVar[int]
    ELAPSED_US_FIELD_NUMBER: _ClassVar[int]
    iteration: int
    cost: float
    accepted: bool
    gradient_max_norm: float
    step_norm: float
    damping: float
    step_quality: float
    elapsed_us: int
    def __init__(self, iteration: _Optional[int] = ..., cost: _Optional[float] = ..., accepted: bool = ..., gradient_max_norm: _Optional[float] = ..., step_norm: _Optional[float] = ..., damping: _Optional[float] = ..., step_quality: _Optional[float] = ..., elapsed_us: _Optional[int] = ...) -> None: ...

class FactorCost(_message.Message):
    __slots__ = ("kind", "factor_count", "initial_cost", "final_cost")
    KIND_FIELD_NUMBER: _ClassVar[int]
    FACTOR_COUNT_FIELD_NUMBER: _ClassVar[int]
    INITIAL_COST_FIELD_NUMBER: _ClassVar[int]
    FINAL_COST_FIELD_NUMBER: _ClassVar[int]
    kind: FactorKind
    factor_count: int
    initial_cost: float
    final_cost: float
    def __init__(self, kind: _Optional[_Union[FactorKind, str]] = ..., factor_count: _Optional[int] = ..., initial_cost: _Optional[float] = ..., final_cost: _Optional[float] = ...) -> None: ...

class ReprojectionStatistics(_message.Message):
    __slots__ = ("observation_count", "initial_rmse_px", "final_rmse_px")
    OBSERVATION_COUNT_FIELD_NUMBER: _ClassVar[int]
    INITIAL_RMSE_PX_FIELD_NUMBER: _ClassVar[int]
    FINAL_RMSE_PX_FIELD_NUMBER: _ClassVar[int]
    observation_count: int
    initial_rmse_px: float
    final_rmse_px: float
    def __init__(self, observation_count: _Optional[int] = ..., initial_rmse_px: _Optional[float] = ..., final_rmse_px: _Optional[float] = ...) -> None: ...

class ResidualStatistics(_message.Message):
    __slots__ = ("kind", "factor_count", "initial_rms", "final_rms", "redundant_count", "initial_redundant_rms", "final_redundant_rms", "reduced_chi2", "outlier_share", "sigma_ratio", "sigma_judgment", "hint")
    KIND_FIELD_NUMBER: _ClassVar[int]
    FACTOR_COUNT_FIELD_NUMBER: _ClassVar[int]
    INITIAL_RMS_FIELD_NUMBER: _ClassVar[int]
    FINAL_RMS_FIELD_NUMBER: _ClassVar[int]
    REDUNDANT_COUNT_FIELD_NUMBER: _ClassVar[int]
    INITIAL_REDUNDANT_RMS_FIELD_NUMBER: _ClassVar[int]
    FINAL_REDUNDANT_RMS_FIELD_NUMBER: _ClassVar[int]
    REDUCED_CHI2_FIELD_NUMBER: _ClassVar[int]
    OUTLIER_SHARE_FIELD_NUMBER: _ClassVar[int]
    SIGMA_RATIO_FIELD_NUMBER: _ClassVar[int]
    SIGMA_JUDGMENT_FIELD_NUMBER: _ClassVar[int]
    HINT_FIELD_NUMBER: _ClassVar[int]
    kind: ResidualKind
    factor_count: int
    initial_rms: float
    final_rms: float
    redundant_count: int
    initial_redundant_rms: float
    final_redundant_rms: float
    reduced_chi2: float
    outlier_share: float
    sigma_ratio: float
    sigma_judgment: SigmaJudgment
    hint: str
    def __init__(self, kind: _Optional[_Union[ResidualKind, str]] = ..., factor_count: _Optional[int] = ..., initial_rms: _Optional[float] = ..., final_rms: _Optional[float] = ..., redundant_count: _Optional[int] = ..., initial_redundant_rms: _Optional[float] = ..., final_redundant_rms: _Optional[float] = ..., reduced_chi2: _Optional[float] = ..., outlier_share: _Optional[float] = ..., sigma_ratio: _Optional[float] = ..., sigma_judgment: _Optional[_Union[SigmaJudgment, str]] = ..., hint: _Optional[str] = ...) -> None: ...

class SolveSummary(_message.Message):
    __slots__ = ("termination", "description", "initial_cost", "final_cost", "factor_costs", "gradient_max_norm", "linear_residual", "thread_count", "iteration_count", "accepted_iteration_count", "method", "linear_solver", "gauge", "behind_camera_observation_count", "reprojection", "free_pose_count", "fixed_pose_count", "free_landmark_count", "solve_duration_us", "simd_class", "residuals", "closures", "held_keyframes")
    TERMINATION_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    INITIAL_COST_FIELD_NUMBER: _ClassVar[int]
    FINAL_COST_FIELD_NUMBER: _ClassVar[int]
    FACTOR_COSTS_FIELD_NUMBER: _ClassVar[int]
    GRADIENT_MAX_NORM_FIELD_NUMBER: _ClassVar[int]
    LINEAR_RESIDUAL_FIELD_NUMBER: _ClassVar[int]
    THREAD_COUNT_FIELD_NUMBER: _ClassVar[int]
    ITERATION_COUNT_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_ITERATION_COUNT_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    LINEAR_SOLVER_FIELD_NUMBER: _ClassVar[int]
    GAUGE_FIELD_NUMBER: _ClassVar[int]
    BEHIND_CAMERA_OBSERVATION_COUNT_FIELD_NUMBER: _ClassVar[int]
    REPROJECTION_FIELD_NUMBER: _ClassVar[int]
    FREE_POSE_COUNT_FIELD_NUMBER: _ClassVar[int]
    FIXED_POSE_COUNT_FIELD_NUMBER: _ClassVar[int]
    FREE_LANDMARK_COUNT_FIELD_NUMBER: _ClassVar[int]
    SOLVE_DURATION_US_FIELD_NUMBER: _ClassVar[int]
    SIMD_CLASS_FIELD_NUMBER: _ClassVar[int]
    RESIDUALS_FIELD_NUMBER: _ClassVar[int]
    CLOSURES_FIELD_NUMBER: _ClassVar[int]
    HELD_KEYFRAMES_FIELD_NUMBER: _ClassVar[int]
    termination: Termination
    description: str
    initial_cost: float
    final_cost: float
    factor_costs: _containers.RepeatedCompositeFieldContainer[FactorCost]
    gradient_max_norm: float
    linear_residual: float
    thread_count: int
    iteration_count: int
    accepted_iteration_count: int
    method: SolverMethod
    linear_solver: LinearSolver
    gauge: Gauge
    behind_camera_observation_count: int
    reprojection: ReprojectionStatistics
    free_pose_count: int
    fixed_pose_count: int
    free_landmark_count: int
    solve_duration_us: int
    simd_class: str
    residuals: _containers.RepeatedCompositeFieldContainer[ResidualStatistics]
    closures: ClosureSummary
    held_keyframes: _containers.RepeatedCompositeFieldContainer[HeldKeyframe]
    def __init__(self, termination: _Optional[_Union[Termination, str]] = ..., description: _Optional[str] = ..., initial_cost: _Optional[float] = ..., final_cost: _Optional[float] = ..., factor_costs: _Optional[_Iterable[_Union[FactorCost, _Mapping]]] = ..., gradient_max_norm: _Optional[float] = ..., linear_residual: _Optional[float] = ..., thread_count: _Optional[int] = ..., iteration_count: _Optional[int] = ..., accepted_iteration_count: _Optional[int] = ..., method: _Optional[_Union[SolverMethod, str]] = ..., linear_solver: _Optional[_Union[LinearSolver, str]] = ..., gauge: _Optional[_Union[Gauge, str]] = ..., behind_camera_observation_count: _Optional[int] = ..., reprojection: _Optional[_Union[ReprojectionStatistics, _Mapping]] = ..., free_pose_count: _Optional[int] = ..., fixed_pose_count: _Optional[int] = ..., free_landmark_count: _Optional[int] = ..., solve_duration_us: _Optional[int] = ..., simd_class: _Optional[str] = ..., residuals: _Optional[_Iterable[_Union[ResidualStatistics, _Mapping]]] = ..., closures: _Optional[_Union[ClosureSummary, _Mapping]] = ..., held_keyframes: _Optional[_Iterable[_Union[HeldKeyframe, _Mapping]]] = ...) -> None: ...

class HeldKeyframe(_message.Message):
    __slots__ = ("client_id", "keyframe_id", "reason")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_ID_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    keyframe_id: int
    reason: HoldReason
    def __init__(self, client_id: _Optional[str] = ..., keyframe_id: _Optional[int] = ..., reason: _Optional[_Union[HoldReason, str]] = ...) -> None: ...
