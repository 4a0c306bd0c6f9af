// What every twin records of a solve and prints of it, in the words of `covis solve --json`.
#ifndef COVIS_REFERENCE_TRACE_H_
#define COVIS_REFERENCE_TRACE_H_

#include <chrono>
#include <vector>

#include <ceres/ceres.h>

using Clock = std::chrono::steady_clock;

double SecondsSince(Clock::time_point start);

struct Row {
  double cost, seconds;
  bool accepted;
};

// A row an iteration; seconds count from `start`. A rejected step repeats the cost before it.
class Recorder : public ceres::IterationCallback {
 public:
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override;

  Clock::time_point start;
  std::vector<Row> rows;
};

// covis' own tolerances: a relative decrease of 1e-9 ends a solve, the others hardly ever do.
void SetTolerances(ceres::Solver::Options& options);

// The rest of a JSON object that the caller has opened and written members of, a comma after the last.
void PrintSolve(const Recorder& recorder, const ceres::Solver::Summary& summary, double build_seconds,
                double solve_seconds);

#endif  // COVIS_REFERENCE_TRACE_H_
