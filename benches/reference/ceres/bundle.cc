// The Ceres twin of `covis solve bundle`: the same file, the same cost, another solver.
//
// Minimizes 1/2 sum ||predicted - measured||^2 in px^2 over every observation of a BAL file (those
// behind their camera included), from the file's start, with 9 unknowns a camera or, with
// --fix-intrinsics, 6. No gauge is fixed, as in Ceres' own bundle adjuster.
//
// Prints one JSON document in the words of `covis solve bundle --json`. Seconds count from the call
// of ceres::Solve, so Ceres' preprocessing is in them; what it takes to add the residual blocks
// before is told apart, as build_seconds.

#include <cstdio>
#include <iostream>
#include <stdexcept>
#include <string>
#include <string_view>

#include <ceres/ceres.h>

#include "bal.h"
#include "residuals.h"
#include "trace.h"

namespace {

struct Arguments {
  std::string file, out, linear_solver = "sparse-schur";
  int threads = 1, max_iterations = 100;
  bool fix_intrinsics = false, analytic = false;
};

constexpr const char* kUsage =
    "usage: bundle FILE [--linear-solver dense-schur|sparse-schur|iterative-schur] [--threads N]\n"
    "              [--max-iterations N] [--fix-intrinsics] [--analytic] [--out FILE]\n";

Arguments Parse(int count, char** values) {
  Arguments arguments;
  int k = 1;
  const auto next = [&] {
    if (++k >= count) throw std::invalid_argument(kUsage);
    return std::string(values[k]);
  };
  for (; k < count; ++k) {
    const std::string_view name = values[k];
    if (name == "--linear-solver") arguments.linear_solver = next();
    else if (name == "--threads") arguments.threads = std::stoi(next());
    else if (name == "--max-iterations") arguments.max_iterations = std::stoi(next());
    else if (name == "--out") arguments.out = next();
    else if (name == "--fix-intrinsics") arguments.fix_intrinsics = true;
    else if (name == "--analytic") arguments.analytic = true;
    else if (arguments.file.empty() && name.substr(0, 1) != "-") arguments.file = name;
    else throw std::invalid_argument(kUsage);
  }
  if (arguments.file.empty()) throw std::invalid_argument(kUsage);
  return arguments;
}

ceres::Solver::Options MakeOptions(const Arguments& arguments) {
  ceres::Solver::Options options;
  const std::string& name = arguments.linear_solver;
  if (name == "dense-schur") {
    options.linear_solver_type = ceres::DENSE_SCHUR;
  } else if (name == "sparse-schur") {
    options.linear_solver_type = ceres::SPARSE_SCHUR;
  } else if (name == "iterative-schur") {
    options.linear_solver_type = ceres::ITERATIVE_SCHUR;
    options.preconditioner_type = ceres::SCHUR_JACOBI;
  } else {
    throw std::invalid_argument(kUsage);
  }
  // The faster of Ceres' dense backends wherever a tuned LAPACK is installed.
  if (ceres::IsDenseLinearAlgebraLibraryTypeAvailable(ceres::LAPACK))
    options.dense_linear_algebra_library_type = ceres::LAPACK;
  options.num_threads = arguments.threads;
  options.max_num_iterations = arguments.max_iterations;
  SetTolerances(options);
  return options;
}

void Run(const Arguments& arguments) {
  ceres::Solver::Options options = MakeOptions(arguments);
  BalFile file = ReadBal(arguments.file);

  const auto begin = Clock::now();
  ceres::Problem problem;
  const auto make = arguments.analytic ? MakeAnalytic : MakeAutomatic;
  for (const Observation& o : file.observations) {
    Camera& camera = file.cameras[o.camera];
    ceres::CostFunction* residual = make(o, camera, arguments.fix_intrinsics);
    problem.AddResidualBlock(residual, nullptr, camera.data(), file.points[o.point].data());
  }
  // Points are eliminated first. Only after the loop: nodes of the ordering between the cost
  // functions would spread these over more cache lines.
  auto* ordering = new ceres::ParameterBlockOrdering;
  for (const Observation& o : file.observations) {
    ordering->AddElementToGroup(file.points[o.point].data(), 0);
    ordering->AddElementToGroup(file.cameras[o.camera].data(), 1);
  }
  options.linear_solver_ordering.reset(ordering);
  const double build_seconds = SecondsSince(begin);

  Recorder recorder;
  options.callbacks.push_back(&recorder);
  ceres::Solver::Summary summary;
  recorder.start = Clock::now();
  ceres::Solve(options, &problem, &summary);
  const double solve_seconds = SecondsSince(recorder.start);
  if (!summary.IsSolutionUsable()) throw std::runtime_error(summary.message);
  if (!arguments.out.empty()) WriteBal(file, arguments.out);
  std::printf("{\"derivatives\":\"%s\",\"linear_solver\":\"%s\",\"fixed_intrinsics\":%s,",
              arguments.analytic ? "analytic" : "automatic", arguments.linear_solver.c_str(),
              arguments.fix_intrinsics ? "true" : "false");
  PrintSolve(recorder, summary, build_seconds, solve_seconds);
}

}  // namespace

int main(int count, char** values) {
  Arguments arguments;
  try {
    arguments = Parse(count, values);
    Run(arguments);
  } catch (const std::invalid_argument& error) {
    std::cerr << error.what();
    return 2;
  } catch (const std::exception& error) {
    std::cerr << "error: " << arguments.file << ": " << error.what() << "\n";
    return 1;
  }
  return 0;
}
