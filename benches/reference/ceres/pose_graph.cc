// The Ceres twin of `covis solve pose-graph`: the same file, the same cost, another solver.
//
// Minimizes 1/2 sum r' Omega r, r = Log(Z^-1 Xi^-1 Xj) by the logarithm of the whole group, over the
// edges of a g2o file in SE(2) or SE(3), the lowest id held. Levenberg-Marquardt with sparse normal
// Cholesky. --start given takes the file's vertices, tree strings measurements together, as few as
// possible to each vertex; Ceres has no start of its own.
//
// A pose is one parameter block, its derivatives are by hand and for the tangent: the cost function
// says them in the first columns and the manifold keeps these. So Ceres neither differentiates nor
// multiplies with the derivative of a quaternion.
//
// Prints one JSON document in the words of `covis solve pose-graph --json`. Seconds count from the
// making of the start, less what it takes to add the residual blocks after, told as build_seconds.

#include <cstdio>
#include <iostream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <ceres/ceres.h>

#include "g2o.h"
#include "groups.h"
#include "trace.h"

namespace {

// Poses whose update is X Exp(d); a derivative for d stands in the first columns of one for X.
template <typename Group>
class Motion : public ceres::Manifold {
 public:
  int AmbientSize() const override { return Group::kAmbient; }
  int TangentSize() const override { return Group::kTangent; }

  bool Plus(const double* x, const double* delta, double* out) const override {
    double step[Group::kAmbient];
    Group::Exp(delta, step);
    Group::Compose(x, step, out);
    return true;
  }

  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, Group::kAmbient, Group::kTangent, Eigen::RowMajor>>(jacobian).setIdentity();
    return true;
  }

  // A solve does not ask for differences.
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }
};

template <typename Group>
class Between : public ceres::SizedCostFunction<Group::kTangent, Group::kAmbient, Group::kAmbient> {
 public:
  using Square = typename Group::Square;

  explicit Between(const G2oEdge& edge) {
    Group::Inverse(edge.measured.data(), measured_inverse_);
    Square information;
    int next = 0;
    for (int row = 0; row < Group::kTangent; ++row)
      for (int column = row; column < Group::kTangent; ++column)
        information(row, column) = information(column, row) = edge.information[next++];
    const Eigen::LLT<Square> factor(information);
    if (factor.info() != Eigen::Success) throw std::runtime_error("an information matrix is not positive definite");
    weight_ = factor.matrixU();
  }

  bool Evaluate(double const* const* poses, double* residuals, double** jacobians) const override {
    double i_inverse[Group::kAmbient], predicted[Group::kAmbient], error[Group::kAmbient];
    Group::Inverse(poses[0], i_inverse);
    Group::Compose(i_inverse, poses[1], predicted);
    Group::Compose(measured_inverse_, predicted, error);
    Square log;
    const typename Group::Tangent r = Group::Log(error, jacobians == nullptr ? nullptr : &log);
    Eigen::Map<typename Group::Tangent>{residuals}.noalias() = weight_ * r;
    if (jacobians == nullptr) return true;
    const Square of_j = weight_ * log;
    if (jacobians[0] != nullptr) {
      double inverse[Group::kAmbient];
      Group::Inverse(predicted, inverse);
      Write(-of_j * Group::Adjoint(inverse), jacobians[0]);
    }
    if (jacobians[1] != nullptr) Write(of_j, jacobians[1]);
    return true;
  }

 private:
  static void Write(const Square& of_tangent, double* jacobian) {
    Eigen::Map<Eigen::Matrix<double, Group::kTangent, Group::kAmbient, Eigen::RowMajor>> all(jacobian);
    all.setZero();
    all.template leftCols<Group::kTangent>() = of_tangent;
  }

  double measured_inverse_[Group::kAmbient];
  Square weight_;  // W with Omega = W' W
};

// Measurements strung together from the lowest id, as few as possible to each vertex.
template <typename Group>
void SpanningTree(G2oFile& file) {
  std::vector<std::vector<std::pair<int, const G2oEdge*>>> beside(file.poses.size());
  for (const G2oEdge& edge : file.edges) {
    beside[edge.i].emplace_back(edge.j, &edge);
    beside[edge.j].emplace_back(edge.i, &edge);
  }
  if (!file.has_vertices) Group::Identity(file.poses[0].data());
  std::vector<bool> is_reached(file.poses.size(), false);
  is_reached[0] = true;
  std::vector<int> queue{0};
  for (std::size_t k = 0; k < queue.size(); ++k) {
    const int from = queue[k];
    for (const auto& [to, edge] : beside[from]) {
      if (is_reached[to]) continue;
      is_reached[to] = true;
      queue.push_back(to);
      double step[Group::kAmbient];
      if (edge->i == from) Group::Compose(file.poses[from].data(), edge->measured.data(), file.poses[to].data());
      else {
        Group::Inverse(edge->measured.data(), step);
        Group::Compose(file.poses[from].data(), step, file.poses[to].data());
      }
    }
  }
  if (queue.size() < file.poses.size()) throw std::runtime_error("the graph is not connected");
}

struct Arguments {
  std::string file, out, start = "given";
  int threads = 1, max_iterations = 100;
};

constexpr const char* kUsage =
    "usage: pose_graph FILE [--start given|tree] [--threads N] [--max-iterations N] [--out FILE]\n";

Arguments Parse(int count, char** values) {
  Arguments arguments;
  int k = 1;
  const auto next = [&] {
    if (++k >= count) throw std::invalid_argument(kUsage);
    return std::string(values[k]);
  };
  for (; k < count; ++k) {
    const std::string_view name = values[k];
    if (name == "--start") arguments.start = next();
    else if (name == "--threads") arguments.threads = std::stoi(next());
    else if (name == "--max-iterations") arguments.max_iterations = std::stoi(next());
    else if (name == "--out") arguments.out = next();
    else if (arguments.file.empty() && name.substr(0, 1) != "-") arguments.file = name;
    else throw std::invalid_argument(kUsage);
  }
  const bool is_start = arguments.start == "given" || arguments.start == "tree";
  if (arguments.file.empty() || !is_start) throw std::invalid_argument(kUsage);
  return arguments;
}

template <typename Group>
void Solve(const Arguments& arguments, G2oFile& file) {
  const auto begin = Clock::now();
  if (arguments.start == "tree") SpanningTree<Group>(file);
  else if (!file.has_vertices) throw std::runtime_error("has no vertices: --start tree");
  const double start_seconds = SecondsSince(begin);

  const auto build = Clock::now();
  ceres::Problem problem;
  auto* motion = new Motion<Group>;
  for (PoseNumbers& pose : file.poses) problem.AddParameterBlock(pose.data(), Group::kAmbient, motion);
  for (const G2oEdge& edge : file.edges)
    problem.AddResidualBlock(new Between<Group>(edge), nullptr, file.poses[edge.i].data(), file.poses[edge.j].data());
  problem.SetParameterBlockConstant(file.poses[0].data());
  const double build_seconds = SecondsSince(build);

  ceres::Solver::Options options;
  SetTolerances(options);
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.num_threads = arguments.threads;
  options.max_num_iterations = arguments.max_iterations;
  Recorder recorder;
  options.callbacks.push_back(&recorder);
  ceres::Solver::Summary summary;
  recorder.start = begin + (Clock::now() - build);
  ceres::Solve(options, &problem, &summary);
  const double solve_seconds = SecondsSince(recorder.start);
  if (!summary.IsSolutionUsable()) throw std::runtime_error(summary.message);
  if (!arguments.out.empty()) WriteVertices(file, arguments.out);
  std::printf("{\"group\":\"%s\",\"method\":\"lm\",\"init\":\"%s\",\"init_seconds\":%.6f,", file.is_se3 ? "SE3" : "SE2",
              arguments.start.c_str(), start_seconds);
  PrintSolve(recorder, summary, build_seconds, solve_seconds);
}

void Run(const Arguments& arguments) {
  G2oFile file = ReadG2o(arguments.file);
  if (file.edges.empty()) throw std::runtime_error("has no edges");
  if (file.is_se3) Solve<Se3>(arguments, file);
  else Solve<Se2>(arguments, file);
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
