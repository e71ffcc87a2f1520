// SPDX-License-Identifier: Apache-2.0
//
// Noise of cells with every sum computed cell by cell; the method is described in algo/features/seat_noise.cpp.
#include "plain_features.h"

#include <Eigen/Cholesky>
#include <array>

#include "algo/moments.h"

namespace slabd::algo::plain {
namespace {

constexpr std::size_t kCellsMin = 400;
constexpr double kWavelengthMax_mm = 40.0;
constexpr double kWavelengthMin_mm = 10.0;
/// Longer wavelengths count as form in the noise of a cell.
constexpr double kFormLength_mm = 20.0;
constexpr std::size_t kModesMax = 40;  ///< along one axis: 200 mm of seat
constexpr std::size_t kRings = 6;
/// Single energies above this multiple of their ring's level are form (chi-square with one degree of freedom: 5e-4).
constexpr double kEnergyMax = 12.0;
constexpr double kOutlierSigmas = 4.0;

/// Degree of the polynomial that represents the form.
constexpr int kDegree = 4;
constexpr int kTerms = (kDegree + 1) * (kDegree + 2) / 2;
using Terms = Eigen::Matrix<double, kTerms, 1>;

Terms terms_at(double x, double s) {
  Terms terms;
  int k = 0;
  double px = 1.0;
  for (int i = 0; i <= kDegree; ++i, px *= x) {
    double ps = 1.0;
    for (int j = 0; i + j <= kDegree; ++j, ps *= s) terms[k++] = px * ps;
  }
  return terms;
}

double median_of(std::span<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// 1.4826 times the median absolute height of the cells that count.
double robust_sigma_of(std::span<const double> heights, const std::array<bool, limits::kFlatnessCellsMax>& out) {
  std::array<double, limits::kFlatnessCellsMax> size;
  std::size_t n = 0;
  for (std::size_t i = 0; i < heights.size(); ++i)
    if (!out[i]) size[n++] = std::abs(heights[i]);
  return n == 0 ? 0.0 : 1.4826 * median_of(std::span(size).first(n));
}

/// Subtracts the low polynomial, then sets outliers to zero. Returns the number of cells left.
std::size_t remove_form(const CellGrid& grid, std::span<double> heights, std::span<const std::uint32_t> cells) {
  std::array<bool, limits::kFlatnessCellsMax> out{};
  std::size_t left = heights.size();
  const auto terms_of = [&](std::size_t i) {
    return terms_at(grid.x_of(cells[i]) / grid.region.half_x_mm, grid.s_of(cells[i]) / grid.region.half_s_mm);
  };
  // A chip affects the polynomial until it is left out.
  for (int round = 0; round < 3; ++round) {
    Eigen::Matrix<double, kTerms, kTerms> H = Eigen::Matrix<double, kTerms, kTerms>::Zero();
    Terms g = Terms::Zero();
    for (std::size_t i = 0; i < heights.size(); ++i) {
      if (out[i]) continue;
      const Terms t = terms_of(i);
      H += t * t.transpose();
      g += heights[i] * t;
    }
    const Terms form = H.ldlt().solve(g);
    if (!form.allFinite()) return 0;
    for (std::size_t i = 0; i < heights.size(); ++i) heights[i] -= form.dot(terms_of(i));
    const double limit = kOutlierSigmas * robust_sigma_of(heights, out);
    left = 0;
    for (std::size_t i = 0; i < heights.size(); ++i) {
      out[i] = std::abs(heights[i]) > limit;
      if (!out[i]) ++left;
    }
  }
  for (std::size_t i = 0; i < heights.size(); ++i)
    if (out[i]) heights[i] = 0.0;
  return left;
}

/// Weighted straight line.
class Line {
 public:
  void add(double x, double y, double weight) {
    n_ += weight;
    x_ += weight * x;
    y_ += weight * y;
    xx_ += weight * x * x;
    xy_ += weight * x * y;
  }
  [[nodiscard]] double slope() const { return (n_ * xy_ - x_ * y_) / (n_ * xx_ - x_ * x_); }
  [[nodiscard]] double mean() const { return y_ / n_; }
  [[nodiscard]] double value_at(double x) const { return mean() + slope() * (x - x_ / n_); }

 private:
  double n_ = 0.0;
  double x_ = 0.0;
  double y_ = 0.0;
  double xx_ = 0.0;
  double xy_ = 0.0;
};

/// Cosine spectrum of the heights over the region.
class Spectrum {
 public:
  Spectrum(const CellGrid& grid, std::span<const double> heights, std::span<const std::uint32_t> cells)
      : across_(2.0 * grid.region.cell_mm * static_cast<double>(grid.columns)),
        along_(2.0 * grid.region.cell_mm * static_cast<double>(grid.rows)) {
    columns_ = modes(across_);
    rows_ = modes(along_);
    for (std::size_t i = 0; i < heights.size(); ++i) {
      Cosines x;
      Cosines s;
      cosines(cells[i] % grid.columns, grid.columns, columns_, x);
      cosines(cells[i] / grid.columns, grid.rows, rows_, s);
      for (std::size_t q = 0; q <= rows_; ++q) {
        const double h = heights[i] * s[q];
        double* row = amplitude_.data() + q * (kModesMax + 1);
        for (std::size_t p = 0; p <= columns_; ++p) row[p] += h * x[p];
      }
    }
    // Orthonormal cosines: 2 / sqrt(cells) for modes that vary both ways.
    scale_ = 4.0 / static_cast<double>(grid.cells());
  }

  /// Sum of the energies of all modes longer than kFormLength_mm, including those along one axis, and their number.
  [[nodiscard]] double form_energy(double& count) const {
    double sum = 0.0;
    count = 0.0;
    for (std::size_t q = 0; q <= rows_; ++q) {
      for (std::size_t p = 0; p <= columns_; ++p) {
        if (k2(p, q) >= 1.0 / (kFormLength_mm * kFormLength_mm)) continue;
        sum += energy(p, q);
        count += 1.0;
      }
    }
    return sum;
  }

  /// Spectral density at infinite wavelength, extrapolated ring by ring from the modes between the two wavelengths, as
  /// the variance of a cell with white noise of that density. NaN if a ring has no modes.
  [[nodiscard]] double at_infinity() const {
    constexpr double k2_min = 1.0 / (kWavelengthMax_mm * kWavelengthMax_mm);
    constexpr double k2_max = 1.0 / (kWavelengthMin_mm * kWavelengthMin_mm);
    std::array<double, kRings> level;
    std::array<double, kRings> count;
    std::array<double, kRings> at;
    Line log_level;
    for (std::size_t ring = 0; ring < kRings; ++ring) {
      const double from = k2_min + (k2_max - k2_min) * static_cast<double>(ring) / kRings;
      const double to = k2_min + (k2_max - k2_min) * static_cast<double>(ring + 1) / kRings;
      level[ring] = mean_energy(from, to, count[ring]);
      if (!(level[ring] > 0.0)) return kNoValue;
      at[ring] = 0.5 * (from + to);
      log_level.add(at[ring], std::log(level[ring]), count[ring]);
    }
    // A mean of n energies has a relative scatter of sqrt(2/n), hence the weights. They come from the smooth line;
    // otherwise rings that are low by chance would have more weight. The reciprocal of the mean is high by 2/n.
    Line reciprocal;
    for (std::size_t ring = 0; ring < kRings; ++ring) {
      const double smooth = std::exp(log_level.value_at(at[ring]));
      reciprocal.add(at[ring], (1.0 - 2.0 / count[ring]) / level[ring], count[ring] * smooth * smooth);
    }
    // Noise never has more energy at short wavelengths than at long ones.
    return 1.0 / (reciprocal.slope() > 0.0 ? reciprocal.value_at(0.0) : reciprocal.mean());
  }

 private:
  using Cosines = std::array<double, kModesMax + 1>;
  static std::size_t modes(double twice_length_mm) {
    return std::min(static_cast<std::size_t>(twice_length_mm / kWavelengthMin_mm), kModesMax);
  }
  /// cos(p pi (i + 1/2) / n) for p = 0..count, by the angle addition rule.
  static void cosines(std::size_t i, std::size_t n, std::size_t count, Cosines& c) {
    const double one = std::cos(kPi * (static_cast<double>(i) + 0.5) / static_cast<double>(n));
    c[0] = 1.0;
    c[1] = one;
    for (std::size_t p = 2; p <= count; ++p) c[p] = 2.0 * one * c[p - 1] - c[p - 2];
  }
  /// Square of the wave number of a mode (1/mm^2), and its energy (mm^2).
  [[nodiscard]] double k2(std::size_t p, std::size_t q) const {
    const double kx = static_cast<double>(p) / across_;
    const double ks = static_cast<double>(q) / along_;
    return kx * kx + ks * ks;
  }
  [[nodiscard]] double energy(std::size_t p, std::size_t q) const {
    const double a = amplitude_[q * (kModesMax + 1) + p];
    return scale_ * (p == 0 ? 0.5 : 1.0) * (q == 0 ? 0.5 : 1.0) * a * a;
  }
  [[nodiscard]] double mean_energy(double from, double to, double& count) const {
    std::array<double, kModesMax * kModesMax> energies;
    std::size_t n = 0;
    for (std::size_t q = 1; q <= rows_; ++q) {
      for (std::size_t p = 1; p <= columns_; ++p) {
        if (k2(p, q) < from || k2(p, q) >= to) continue;
        energies[n++] = energy(p, q);
      }
    }
    count = 0.0;
    if (n == 0) return kNoValue;
    const std::span<double> all = std::span(energies).first(n);
    // Median of chi-square with one degree of freedom relative to its mean.
    const double limit = kEnergyMax * median_of(all) / 0.4549;
    double sum = 0.0;
    for (const double e : all) {
      if (e > limit) continue;
      sum += e;
      count += 1.0;
    }
    return sum / count;
  }

  double across_;
  double along_;
  std::size_t columns_ = 0;
  std::size_t rows_ = 0;
  double scale_ = 0.0;
  std::array<double, (kModesMax + 1) * (kModesMax + 1)> amplitude_{};
};

}  // namespace

CellNoise noise_of_cells(const CellGrid& grid, std::span<double> heights, std::span<const std::uint32_t> cells,
                         double within_variance_mm2, double points_per_cell) {
  CellNoise noise;
  if (heights.size() < kCellsMin || heights.size() > limits::kFlatnessCellsMax || !(points_per_cell >= 1.0) ||
      2.0 * std::fmin(grid.region.half_x_mm, grid.region.half_s_mm) < kWavelengthMax_mm)
    return noise;
  const std::size_t left = remove_form(grid, heights, cells);
  if (left < kCellsMin) return noise;
  // Empty and excluded cells have height zero: the energies lack their part.
  const double present = static_cast<double>(left) / static_cast<double>(grid.cells());
  const Spectrum spectrum(grid, heights, cells);
  const double density = spectrum.at_infinity() / present;
  // The sum of all energies is that of the squared heights; the long ones are replaced by the noise density there.
  double long_modes = 0.0;
  ScalarMoments squares(0.0);
  for (const double h : heights) squares.add(h * h);
  squares.close_block();
  const double total = squares.mean() * static_cast<double>(heights.size());
  const double noise_energy = total - spectrum.form_energy(long_modes);
  const double cell_variance = (noise_energy / present + long_modes * density) / static_cast<double>(grid.cells());
  const double point_variance = cell_variance + (1.0 - 1.0 / points_per_cell) * within_variance_mm2;
  if (!(cell_variance > 0.0) || !(point_variance > 0.0)) return noise;
  noise.ok = true;
  noise.cell_sigma_mm = std::sqrt(cell_variance);
  noise.point_sigma_mm = std::sqrt(point_variance);
  noise.factor = std::fmax(density * points_per_cell / point_variance, 1.0);
  return noise;
}

}  // namespace slabd::algo::plain
