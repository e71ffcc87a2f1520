// SPDX-License-Identifier: Apache-2.0
//
// The whitened residuals w of a set have the covariance s^2 I when every view errs anew. When views of one place share
// a part of it, rows of the same meaning (slots) of two such views have the covariance s^2 share. Then
//
//     E |w|^2      = s^2 (F - share h)     F = rows - leverage
//     E |within|^2 = s^2 (1 - share) d     within: from the mean of its slot in its place; d degrees of freedom
//
// where h sums j N^-1 k' over pairs of rows j, k of one slot: whatever a place's views share, the parameters follow.
// Two equations give s and the share. A sandwich of squared sums of residuals alone would need no model, but ten places
// with their 30 equations for 9 parameters are far too few for it, with repeats and without.
#include "calib/places.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "calib/matrices.h"
#include "calib/weakness.h"

namespace slabd::calib {
namespace {

constexpr std::size_t kParts = 2;  ///< rotations, positions

/// Rows of the same slot mean the same in every view: an axis of a ball, of the artefact's turn or of its origin.
int slot_of(const Equations& equations, std::size_t view, int row) {
  if (equations.kind() == ArtefactKind::pose) return row;
  return 3 * static_cast<int>(equations.view(view).balls[static_cast<std::size_t>(row / 3)].ball) + row % 3;
}

int slots(const Equations& equations) {
  return equations.kind() == ArtefactKind::pose ? 6 : 3 * static_cast<int>(equations.targets());
}

struct Slot {
  double count = 0.0;
  double sum = 0.0;
  double squares = 0.0;
  double leverage = 0.0;
  Eigen::RowVectorXd J;
};

}  // namespace

std::vector<std::vector<std::size_t>> places_of(const Equations& equations, std::span<const std::size_t> chosen) {
  std::vector<std::vector<std::size_t>> places;
  for (const std::size_t i : chosen) {
    const Pose& pose = equations.view(i).T_base_flange;
    const auto known = std::find_if(places.begin(), places.end(), [&](const std::vector<std::size_t>& place) {
      return same_place(equations.view(place.front()).T_base_flange, pose);
    });
    if (known == places.end())
      places.push_back({i});
    else
      known->push_back(i);
  }
  return places;
}

SharedErrors shared_errors(const Equations& equations, std::span<const std::size_t> chosen, const Linearised& linear) {
  const std::vector<std::vector<std::size_t>> places = places_of(equations, chosen);
  SharedErrors shared;
  shared.repeats = places.size() < chosen.size();
  if (!shared.repeats) return shared;

  const Eigen::MatrixXd inverse = parameter_covariance(equations, chosen, linear);
  double squares = 0.0;
  double freedom = 0.0;
  std::array<double, kParts> within{};
  std::array<double, kParts> within_freedom{};
  std::array<double, kParts> followed{};  // h
  for (const std::vector<std::size_t>& place : places) {
    std::vector<Slot> seen(static_cast<std::size_t>(slots(equations)));
    for (const std::size_t i : place)
      for (int row = 0; row < equations.rows(i); ++row) {
        Slot& slot = seen[static_cast<std::size_t>(slot_of(equations, i, row))];
        const Eigen::RowVectorXd J = linear.J[i].row(row);
        const double w = linear.w[i][row];
        slot.J = slot.count > 0.0 ? Eigen::RowVectorXd(slot.J + J) : J;
        slot.count += 1.0;
        slot.sum += w;
        slot.squares += w * w;
        slot.leverage += carried(J, inverse).value();
      }
    for (std::size_t k = 0; k < seen.size(); ++k) {
      const Slot& slot = seen[k];
      if (slot.count < 1.0) continue;
      squares += slot.squares;
      freedom += slot.count - slot.leverage;
      if (slot.count < 2.0) continue;
      const std::size_t part = static_cast<int>(k) < equations.rotation_rows() ? 0 : 1;
      within[part] += std::max(0.0, slot.squares - slot.sum * slot.sum / slot.count);
      within_freedom[part] += slot.count - 1.0;
      followed[part] += carried(slot.J, inverse).value() - slot.leverage;
    }
  }

  // Were every place one view, this many equations would be left over, each counted as often as it was repeated.
  constexpr double kSome = 0.5;
  double rest = freedom;
  double left = squares;
  std::array<double, kParts> anew{};  // variance that is drawn anew
  for (std::size_t k = 0; k < kParts; ++k) {
    anew[k] = within_freedom[k] > 0.0 ? within[k] / within_freedom[k] : 0.0;
    rest -= followed[k];
    left -= anew[k] * followed[k];
  }
  std::array<double, kParts> share{1.0, 1.0};
  const bool tells = rest > kSome && left > 0.0;
  for (std::size_t k = 0; k < kParts && tells; ++k) share[k] = std::clamp(1.0 - anew[k] * rest / left, 0.0, 1.0);
  double expected = freedom;
  for (std::size_t k = 0; k < kParts; ++k) expected -= share[k] * followed[k];
  if (equations.rotation_rows() == 0) share[0] = 0.0;
  shared.rotation_share = share[0];
  shared.position_share = share[1];
  double pairs = 0.0;
  for (const std::vector<std::size_t>& place : places) pairs += static_cast<double>(place.size() * (place.size() - 1));
  shared.design_effect = 1.0 + pairs / static_cast<double>(chosen.size()) * std::max(share[0], share[1]);
  if (tells && expected > kSome) shared.size = std::sqrt(squares / expected);
  return shared;
}

Eigen::MatrixXd covariance_of_estimate(const Equations& equations, std::span<const std::size_t> chosen,
                                       const Linearised& linear, const State& state, const Weighing& weighing,
                                       const Weighing& errors, const SharedErrors& shared) {
  const Eigen::MatrixXd N_inverse = parameter_covariance(equations, chosen, linear);
  const auto parameters = N_inverse.rows();
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(parameters, parameters);
  for (const std::vector<std::size_t>& place : places_of(equations, chosen)) {
    Eigen::MatrixXd together = Eigen::MatrixXd::Zero(parameters, slots(equations));
    for (const std::size_t i : place) {
      // w = L^-1 r has the covariance (L^-1 K) (L^-1 K)' if that of r is K K'.
      const Eigen::MatrixXd K = inverse(equations.whitener(i, state, errors));
      Eigen::MatrixXd scores = transposed_product(linear.J[i], product(equations.whitener(i, state, weighing), K));
      if (place.size() > 1)
        for (int row = 0; row < scores.cols(); ++row) {
          const double share = row < equations.rotation_rows() ? shared.rotation_share : shared.position_share;
          together.col(slot_of(equations, i, row)) += std::sqrt(share) * scores.col(row);
          scores.col(row) *= std::sqrt(1.0 - share);
        }
      sum += product(scores, scores.transpose());
    }
    if (place.size() > 1) sum += product(together, together.transpose());
  }
  return carried(N_inverse, sum);
}

}  // namespace slabd::calib
