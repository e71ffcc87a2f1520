// SPDX-License-Identifier: Apache-2.0
#include "tests/accuracy/slab_truth.h"

#include <Eigen/QR>
#include <cmath>

namespace slabd::accuracy {
namespace {

std::size_t index(int station) {
  return static_cast<std::size_t>(station - 1);
}

}  // namespace

SlabTruthItems::SlabTruthItems(const Recipe& recipe, const emulator::SlabTruth& slab, const std::set<int>& displaced)
    : recipe_(recipe), slab_(slab) {
  // Displacement of the seats from their nominal positions, less the small rigid motion that explains most of it:
  // plain least squares on three equations a seat, d = t + w x p.
  const int n = slab.stations;
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(3 * n, 6);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(3 * n);
  for (int k = 1; k <= n; ++k) {
    off_[index(k)] = slab.at(k).offset_slab_mm;
    if (displaced.contains(k) || !slab.at(k).block.present) continue;
    const Vec3 p = T_slab_block(recipe, k).translation_mm;
    const int row = 3 * (k - 1);
    A.block<3, 3>(row, 0).setIdentity();
    A.block<3, 3>(row, 3) << 0.0, p.z(), -p.y(), -p.z(), 0.0, p.x(), p.y(), -p.x(), 0.0;
    b.segment<3>(row) = off_[index(k)];
  }
  const Eigen::VectorXd motion = A.colPivHouseholderQr().solve(b);
  const Vec3 t = motion.head<3>();
  const Vec3 w = motion.tail<3>();
  for (int k = 1; k <= n; ++k) off_[index(k)] -= t + w.cross(T_slab_block(recipe, k).translation_mm);
  into_frame_ = Mat3::Identity();
  into_frame_ << 1.0, w.z(), -w.y(), -w.z(), 1.0, w.x(), w.y(), -w.x(), 1.0;

  const int pairs = recipe.slab.pairs;
  for (const int first : {1, pairs + 1}) {
    Eigen::MatrixXd P = Eigen::MatrixXd::Zero(pairs, 3);
    Eigen::VectorXd z = Eigen::VectorXd::Zero(pairs);
    const auto basis = [&](int k) -> Vec3 {
      const double x = T_slab_block(recipe, k).translation_mm.x() / 1000.0;
      return {1.0, x, x * x};
    };
    for (int i = 0; i < pairs; ++i) {
      const int k = first + i;
      if (displaced.contains(k) || !slab.at(k).block.present) continue;
      P.row(i) = basis(k).transpose();
      z[i] = off_[index(k)].z();
    }
    const Vec3 parabola = P.colPivHouseholderQr().solve(z);
    for (int k = first; k < first + pairs; ++k) off_parabola_[index(k)] = off_[index(k)].z() - parabola.dot(basis(k));
  }
}

double SlabTruthItems::value(ItemId id, int station) const {
  switch (id) {
    case ItemId::seat_lateral: return off_[index(station)].y();
    case ItemId::seat_vertical: return recipe_.remove_warp ? off_parabola_[index(station)] : off_[index(station)].z();
    case ItemId::seat_slope: {
      const double slope = slab_.at(station).block.slope_rad;
      const Quat& turn = T_slab_block(recipe_, station).rotation;
      const Vec3 n = turn.conjugate() * (into_frame_ * (turn * Vec3(0.0, -std::sin(slope), std::cos(slope))));
      return deg_from_rad(std::atan2(-n.y(), n.z()));
    }
    default: return emulator::true_slab_value(recipe_, slab_, id, station);
  }
}

}  // namespace slabd::accuracy
