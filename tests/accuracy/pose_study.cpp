// SPDX-License-Identifier: Apache-2.0
//
// Tests the covariance that a registration reports. Nominal block, white noise along the rays, a new scan and a new
// pose for each seed. The motion from the registered to the true block, normalised by its covariance, must be
// distributed as chi-square with six degrees of freedom. Each component must be distributed as one, with zero mean.
// Scans have a quarter of a million points: the registration samples 65 536 of any number.
#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <array>
#include <cmath>

#include "algo/algo.h"
#include "tests/accuracy/studies.h"
#include "tests/algo/scene.h"

namespace slabd::accuracy {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// Median, 90 % and 95 % of chi-square with six degrees of freedom.
struct Quantile {
  double share;
  double value;
};
constexpr std::array kQuantiles = {Quantile{0.5, 5.348}, Quantile{0.9, 10.645}, Quantile{0.95, 12.592}};
constexpr std::array kNames = {"x", "y", "z", "about x", "about y", "about z"};

Vector6 motion_of(const Pose& pose) {
  const Eigen::AngleAxisd turn{Eigen::Quaterniond(pose.rotation)};
  double angle = turn.angle();
  if (angle > kPi) angle -= 2.0 * kPi;
  Vector6 motion;
  motion << Eigen::Vector3d(pose.translation_mm), angle * turn.axis();
  return motion;
}

}  // namespace

bool pose_study(const StudyOptions& options, Table& table) {
  algo::BlockInspector inspector;
  inspector.use(scene::p5600());
  for (const double noise : {0.01, 0.03, 0.1}) {
    const int scans = options.cases(noise == 0.03 ? 1000 : 200, 20);
    std::vector<double> chi2;
    Vector6 squares = Vector6::Zero();
    Vector6 sum = Vector6::Zero();
    int lost = 0;
    for (int i = 0; i < scans; ++i) {
      scene::Scan scan;
      scan.pitch_mm = 0.8;
      scan.noise_mm = noise;
      scan.seed = options.first + static_cast<std::uint64_t>(i);
      Prng random(scan.seed + 1'000'000);
      const auto within = [&](double amplitude) { return amplitude * (2.0 * random.uniform() - 1.0); };
      const double x = within(3.0), y = within(3.0), z = within(3.0);
      const double rx = within(0.5), ry = within(0.5), rz = within(0.5);
      scan.displacement = scene::displaced(x, y, z, rx, ry, rz);
      scene::Cloud cloud = scene::take({}, scan);
      inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
      algo::Cloud view = cloud.view();
      if (!inspector.denoise(view) || !inspector.register_to_model(view)) {
        ++lost;
        continue;
      }
      const RegistrationReport& report = inspector.result().registration;
      const Vector6 e = motion_of(report.T_scanner_block.inverse() * cloud.T_block_scanner.inverse());
      const Matrix6 C = report.covariance;
      chi2.push_back(e.dot(Vector6(C.ldlt().solve(e))));
      const Vector6 normalised = e.cwiseQuotient(Vector6(C.diagonal().cwiseSqrt()));
      squares += normalised.cwiseAbs2();
      sum += normalised;
    }
    const std::string at = fmt::format("noise {} mm: ", noise);
    const auto n = static_cast<double>(chi2.size());
    table.at_most(at + "not registered", lost, 0, "");
    table.within(at + fmt::format("mean chi-square of six, {} scans", chi2.size()), mean(chi2), 5.4, 6.6, "");
    for (const Quantile& q : kQuantiles) {
      double below = 0.0;
      for (const double value : chi2) below += value <= q.value ? 1.0 : 0.0;
      // Three standard errors of a share of n scans, at least 0.05.
      const double reach = std::max(0.05, 3.0 * std::sqrt(q.share * (1.0 - q.share) / n));
      table.within(at + fmt::format("share below the {} % point", 100.0 * q.share), below / n, q.share - reach,
                   std::min(q.share + reach, 1.0), "");
    }
    for (int k = 0; k < 6; ++k) {
      table.tell(at + fmt::format("squared error over variance, {}", kNames[static_cast<std::size_t>(k)]),
                 squares[k] / n, "");
      // The mean of n unbiased scans can be off by 3 / sqrt(n): to detect 0.1 of sigma takes a thousand of them.
      table.at_most(at + fmt::format("bias over sigma, {}", kNames[static_cast<std::size_t>(k)]), std::abs(sum[k] / n),
                    std::max(0.1, 3.0 / std::sqrt(n)), "");
    }
  }
  return true;
}

}  // namespace slabd::accuracy
