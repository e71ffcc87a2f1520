// SPDX-License-Identifier: Apache-2.0
//
// Noise of cells by textbook steps: least squares by QR of the matrix of all cells, the cosine transform as two matrix
// products with cos() evaluated for each entry, sorted lists of modes. The method is described in
// algo/features/seat_noise.cpp.
#include "plain_features.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace slabd::algo::plain {
namespace {

double median_of(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

/// Intercept and slope of a weighted straight line.
Eigen::Vector2d line_through(const Eigen::ArrayXd& x, const Eigen::ArrayXd& y, const Eigen::ArrayXd& weight) {
  Eigen::MatrixXd A(x.size(), 2);
  A.col(0) = weight.sqrt();
  A.col(1) = weight.sqrt() * x;
  return A.colPivHouseholderQr().solve((weight.sqrt() * y).matrix());
}

/// Legendre polynomials, whose products up to degree 4 span the same form as the powers.
Eigen::RowVectorXd form_terms(double x, double s) {
  const auto polynomial = [](double t) {
    return std::array{1.0, t, 0.5 * (3.0 * t * t - 1.0), 0.5 * (5.0 * t * t * t - 3.0 * t),
                      0.125 * (35.0 * t * t * t * t - 30.0 * t * t + 3.0)};
  };
  const auto of_x = polynomial(x);
  const auto of_s = polynomial(s);
  Eigen::RowVectorXd terms(15);
  Eigen::Index k = 0;
  for (std::size_t i = 0; i <= 4; ++i)
    for (std::size_t j = 0; i + j <= 4; ++j) terms[k++] = of_x[i] * of_s[j];
  return terms;
}

/// Row p: sqrt(2 / n) cos(p pi (i + 1/2) / n), p = 0 with 1 / sqrt(n): orthonormal.
Eigen::MatrixXd cosines(std::size_t n, std::size_t modes) {
  Eigen::MatrixXd c(static_cast<Eigen::Index>(modes) + 1, static_cast<Eigen::Index>(n));
  for (Eigen::Index p = 0; p < c.rows(); ++p)
    for (Eigen::Index i = 0; i < c.cols(); ++i)
      c(p, i) = std::sqrt((p == 0 ? 1.0 : 2.0) / static_cast<double>(n)) *
                std::cos(kPi * static_cast<double>(p) * (static_cast<double>(i) + 0.5) / static_cast<double>(n));
  return c;
}

struct Mode {
  double waves_per_mm2 = 0.0;  ///< square of the wave number
  double energy_mm2 = 0.0;
  bool along_one_axis = false;
};

std::vector<Mode> spectrum(const CellGrid& grid, const Eigen::MatrixXd& field) {
  const double across_mm = 2.0 * grid.region.cell_mm * static_cast<double>(grid.columns);
  const double along_mm = 2.0 * grid.region.cell_mm * static_cast<double>(grid.rows);
  // Up to 10 mm of wavelength, at most 40 modes along an axis.
  const auto modes = [](double twice_mm) {
    return std::min<std::size_t>(static_cast<std::size_t>(twice_mm / 10.0), 40);
  };
  const Eigen::MatrixXd amplitude =
      cosines(grid.rows, modes(along_mm)) * field * cosines(grid.columns, modes(across_mm)).transpose();
  std::vector<Mode> all;
  for (Eigen::Index q = 0; q < amplitude.rows(); ++q)
    for (Eigen::Index p = 0; p < amplitude.cols(); ++p)
      all.push_back({std::pow(static_cast<double>(p) / across_mm, 2) + std::pow(static_cast<double>(q) / along_mm, 2),
                     amplitude(q, p) * amplitude(q, p), p == 0 || q == 0});
  return all;
}

/// Density at infinite wavelength from six rings of equal area between 40 and 10 mm, at most four times that of the
/// ring with the longest waves. NaN if a ring has no modes.
double density_at_infinity(const std::vector<Mode>& modes) {
  constexpr Eigen::Index kRings = 6;
  const double low = 1.0 / 1600.0;
  const double width = (1.0 / 100.0 - low) / static_cast<double>(kRings);
  Eigen::ArrayXd at(kRings);
  Eigen::ArrayXd level(kRings);
  Eigen::ArrayXd count(kRings);
  for (Eigen::Index ring = 0; ring < kRings; ++ring) {
    const double from = low + width * static_cast<double>(ring);
    std::vector<double> energies;
    for (const Mode& mode : modes)
      if (!mode.along_one_axis && mode.waves_per_mm2 >= from && mode.waves_per_mm2 < from + width)
        energies.push_back(mode.energy_mm2);
    if (energies.empty()) return kNoValue;
    // Form: more than 12 times the mean of a chi-square distribution whose median is 0.4549 of it.
    const double limit = 12.0 * median_of(energies) / 0.4549;
    std::erase_if(energies, [&](double e) { return e > limit; });
    const auto all = Eigen::Map<const Eigen::ArrayXd>(energies.data(), static_cast<Eigen::Index>(energies.size()));
    at[ring] = from + 0.5 * width;
    level[ring] = all.mean();
    count[ring] = static_cast<double>(energies.size());
    if (!(level[ring] > 0.0)) return kNoValue;
  }
  const Eigen::Vector2d log_line = line_through(at, level.log(), count);
  const Eigen::ArrayXd weight = count * (2.0 * (log_line[0] + log_line[1] * at)).exp();
  const Eigen::ArrayXd reciprocal = (1.0 - 2.0 / count) / level;
  const Eigen::Vector2d line = line_through(at, reciprocal, weight);
  if (!(line[1] > 0.0)) return weight.sum() / (weight * reciprocal).sum();
  return 1.0 / std::fmax(line[0], 0.25 / level[0]);
}

}  // namespace

CellNoise noise_of_cells(const CellGrid& grid, std::span<const double> heights, std::span<const std::uint32_t> cells,
                         double within_variance_mm2, double points_per_cell) {
  constexpr std::size_t kCellsMin = 400;
  CellNoise noise;
  if (heights.size() < kCellsMin || !(points_per_cell >= 1.0) ||
      std::fmin(grid.region.half_x_mm, grid.region.half_s_mm) < 20.0)
    return noise;
  Eigen::VectorXd rest = Eigen::Map<const Eigen::VectorXd>(heights.data(), static_cast<Eigen::Index>(heights.size()));
  Eigen::MatrixXd form(rest.size(), 15);
  for (std::size_t i = 0; i < cells.size(); ++i)
    form.row(static_cast<Eigen::Index>(i)) =
        form_terms(grid.x_of(cells[i]) / grid.region.half_x_mm, grid.s_of(cells[i]) / grid.region.half_s_mm);
  // Three rounds: a chip affects the form until it is left out.
  std::vector<Eigen::Index> kept(heights.size());
  for (std::size_t i = 0; i < kept.size(); ++i) kept[i] = static_cast<Eigen::Index>(i);
  for (int round = 0; round < 3; ++round) {
    rest -= form * form(kept, Eigen::all).colPivHouseholderQr().solve(rest(kept)).eval();
    std::vector<double> size;
    for (const Eigen::Index i : kept) size.push_back(std::abs(rest[i]));
    const double limit = size.empty() ? 0.0 : 4.0 * 1.4826 * median_of(size);
    kept.clear();
    for (Eigen::Index i = 0; i < rest.size(); ++i)
      if (std::abs(rest[i]) <= limit) kept.push_back(i);
  }
  if (kept.size() < kCellsMin) return noise;

  Eigen::MatrixXd field =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(grid.rows), static_cast<Eigen::Index>(grid.columns));
  for (const Eigen::Index i : kept) {
    const std::uint32_t cell = cells[static_cast<std::size_t>(i)];
    field(static_cast<Eigen::Index>(cell / grid.columns), static_cast<Eigen::Index>(cell % grid.columns)) = rest[i];
  }
  const std::vector<Mode> modes = spectrum(grid, field);
  const auto all = static_cast<double>(grid.cells());
  const double present = static_cast<double>(kept.size()) / all;
  const double density = density_at_infinity(modes) / present;
  // Modes longer than 20 mm are form: the noise has its own density there.
  double noise_energy = field.squaredNorm();
  double long_modes = 0.0;
  for (const Mode& mode : modes) {
    if (mode.waves_per_mm2 >= 1.0 / 400.0) continue;
    noise_energy -= mode.energy_mm2;
    long_modes += 1.0;
  }
  const double cell_variance = (noise_energy / present + long_modes * density) / all;
  const double point_variance = cell_variance + (1.0 - 1.0 / points_per_cell) * within_variance_mm2;
  if (!(cell_variance > 0.0) || !(point_variance > 0.0)) return noise;
  return {true, std::sqrt(cell_variance), std::sqrt(point_variance),
          std::fmax(density * points_per_cell / point_variance, 1.0)};
}

}  // namespace slabd::algo::plain
