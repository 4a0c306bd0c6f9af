// What every twin records of a solve and prints of it.

#include "trace.h"

#include <sys/resource.h>

#include <cstddef>
#include <cstdio>

double SecondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

ceres::CallbackReturnType Recorder::operator()(const ceres::IterationSummary& summary) {
  const bool accepted = rows.empty() || summary.step_is_successful;
  rows.push_back({accepted ? summary.cost : rows.back().cost, SecondsSince(start), accepted});
  return ceres::SOLVER_CONTINUE;
}

void SetTolerances(ceres::Solver::Options& options) {
  options.function_tolerance = 1e-9;
  options.gradient_tolerance = 1e-10;
  options.parameter_tolerance = 1e-12;
  options.logging_type = ceres::SILENT;
}

void PrintSolve(const Recorder& recorder, const ceres::Solver::Summary& summary, double build_seconds,
                double solve_seconds) {
  std::printf("\"solver\":\"Ceres %s\",\"threads\":%d,\"initial_cost\":%.17g,\"final_cost\":%.17g,\"iterations\":[",
              CERES_VERSION_STRING, summary.num_threads_used, summary.initial_cost, summary.final_cost);
  for (std::size_t k = 0; k < recorder.rows.size(); ++k) {
    const Row& row = recorder.rows[k];
    std::printf("%s{\"iteration\":%zu,\"cost\":%.17g,\"seconds\":%.6f,\"accepted\":%s}", k == 0 ? "" : ",", k,
                row.cost, row.seconds, row.accepted ? "true" : "false");
  }
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  std::printf("],\"build_seconds\":%.6f,\"solve_seconds\":%.6f,\"peak_memory_mb\":%.1f,", build_seconds,
              solve_seconds, static_cast<double>(usage.ru_maxrss) / 1024.0);
  std::printf("\"linear_solver_seconds\":%.6f,\"residual_seconds\":%.6f,\"jacobian_seconds\":%.6f,",
              summary.linear_solver_time_in_seconds, summary.residual_evaluation_time_in_seconds,
              summary.jacobian_evaluation_time_in_seconds);
  std::printf("\"termination\":\"%s\",\"converged\":%s}\n",
              ceres::TerminationTypeToString(summary.termination_type),
              summary.termination_type == ceres::CONVERGENCE ? "true" : "false");
}
