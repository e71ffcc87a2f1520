// SPDX-License-Identifier: Apache-2.0
//
// Problem: find the effective number of independent points in an average. White noise averages out with the number of
// points. A scanner's errors are shared by neighbours over a millimetre or so, and then a mean over n points is as
// accurate as one over n / factor independent points. The factor is the noise's spectral density at long wavelengths
// relative to white noise of the same size. Only the sum of form and noise is measured, but form has long wavelengths
// (a bow, a wave of centimetres), noise short ones. Idea:
//
//   - a polynomial of fourth degree removes the bow and similar form, and outlier cells (a chip) are left out;
//   - the rest is decomposed into cosines over the region (DCT-II, each normalised so that white noise puts the
//     variance of a cell into every one of them); those along only one axis are skipped, because form tends to follow
//     the axes;
//   - their energies between 40 mm and 10 mm of wavelength, averaged in rings of equal area, are extrapolated to
//     infinite wavelength along 1/energy ~ k^2: exact for exponential correlation, 5 % high for a Gaussian one of 2 mm
//     length, flat for anything much shorter than a cell.
//
// Correlation over more than about 3 mm cannot be separated from form in this way and is not detected.
#include "algo/features/seat_noise.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>

#include "algo/features/cell_sums.h"
#include "algo/median.h"

namespace slabd::algo {
namespace {

constexpr std::size_t kCellsMin = 400;
constexpr double kWavelengthMax_mm = 40.0;
constexpr double kWavelengthMin_mm = 10.0;
/// Longer wavelengths count as form in the noise of a cell.
constexpr double kFormLength_mm = 20.0;
constexpr int kModesMax = 40;  ///< along one axis: 200 mm of seat
constexpr std::size_t kRings = 6;
/// Single energies above this multiple of their ring's level are form (chi-square with one degree of freedom: 5e-4).
constexpr double kEnergyMax = 12.0;
constexpr double kOutlierSigmas = 4.0;

/// Degree of the polynomial that represents the form.
constexpr int kDegree = 4;
constexpr int kTerms = (kDegree + 1) * (kDegree + 2) / 2;
using Terms = Eigen::Matrix<double, kTerms, 1>;

/// Maximum number of cells along one side of the region. A region of at least 40 mm in either direction and of at most
/// limits::kFlatnessCellsMax cells stays below 345 up to 560 mm of length.
constexpr Eigen::Index kAxisMax = 352;

/// Functions of the position along one axis, a row for each position: powers or cosines.
using Table = Eigen::Array<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor, kAxisMax, kModesMax + 1>;
/// Matrix with a row for each function.
template <Eigen::Index kLength>
using Rows = Eigen::Array<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor, kModesMax + 1, kLength>;
/// A value for each cell, row by row.
using Field = Eigen::Map<Eigen::Array<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

/// Powers 0..count - 1 of the positions of `cells` cells along an axis, scaled to -1..1 over 2 * half_mm.
Table powers(std::size_t cells, double cell_mm, double half_mm, int count) {
  Table table(static_cast<Eigen::Index>(cells), count);
  for (Eigen::Index i = 0; i < table.rows(); ++i) {
    const double x = ((static_cast<double>(i) + 0.5) * cell_mm - half_mm) / half_mm;
    table(i, 0) = 1.0;
    for (int k = 1; k < count; ++k) table(i, k) = x * table(i, k - 1);
  }
  return table;
}

/// Sums over all cells of value * f(row) * g(column), for every f and g of two tables: over the rows first, then over
/// the columns. Computed cell by cell, polynomial and cosines would cost thirty times as much.
template <typename Sums>
void sum_products(const Table& along, const Field& values, const Table& across, Sums& sums) {
  Rows<kAxisMax> by_column(along.cols(), values.cols());
  by_column.setZero();
  sums.setZero();
  // Whole rows are added, four at a time, so that no sum waits for the one before.
  const Eigen::Index fours = values.rows() / 4 * 4;
  for (Eigen::Index r = 0; r < fours; r += 4)
    for (Eigen::Index f = 0; f < along.cols(); ++f)
      by_column.row(f) += along(r, f) * values.row(r) + along(r + 1, f) * values.row(r + 1) +
                          along(r + 2, f) * values.row(r + 2) + along(r + 3, f) * values.row(r + 3);
  for (Eigen::Index r = fours; r < values.rows(); ++r)
    for (Eigen::Index f = 0; f < along.cols(); ++f) by_column.row(f) += along(r, f) * values.row(r);
  for (Eigen::Index f = 0; f < along.cols(); ++f)
    for (Eigen::Index c = 0; c < across.rows(); ++c) sums.row(f) += by_column(f, c) * across.row(c);
}

/// 1.4826 times the median absolute height of the cells with weight.
double robust_sigma_of(const Field& heights, const Field& weight) {
  std::array<double, limits::kFlatnessCellsMax> size;
  std::size_t n = 0;
  for (Eigen::Index i = 0; i < heights.size(); ++i) {
    size[n] = std::abs(heights.data()[i]);
    n += weight.data()[i] > 0.0 ? 1U : 0U;
  }
  return 1.4826 * median_of(std::span(size).first(n));
}

/// Subtracts the low polynomial, then sets outliers to zero. `weight` is 1 for existing cells, 0 elsewhere, and on
/// return 1 for the cells kept. Returns their number.
std::size_t remove_form(const CellGrid& grid, Field& heights, Field& weight) {
  constexpr int kPowers = 2 * kDegree + 1;
  const Table across = powers(grid.columns, grid.region.cell_mm, grid.region.half_x_mm, kPowers);
  const Table along = powers(grid.rows, grid.region.cell_mm, grid.region.half_s_mm, kPowers);
  std::array<double, limits::kFlatnessCellsMax> present_room;
  Field present(present_room.data(), weight.rows(), weight.cols());
  present = weight;
  std::array<double, limits::kFlatnessCellsMax> weighted_room;
  Field weighted(weighted_room.data(), weight.rows(), weight.cols());
  using Sums = Eigen::Array<double, kPowers, kPowers, Eigen::RowMajor>;
  Sums of_weight;
  Sums of_height;
  std::size_t left = 0;
  // A chip affects the polynomial until it is left out.
  for (int round = 0; round < 3; ++round) {
    weighted = weight * heights;
    sum_products(along, weight, across, of_weight);
    sum_products(along, weighted, across, of_height);
    // Terms x^i s^j in one fixed order.
    Eigen::Matrix<double, kTerms, kTerms> H;
    Terms g;
    int row = 0;
    for (int i = 0; i <= kDegree; ++i) {
      for (int j = 0; i + j <= kDegree; ++j, ++row) {
        g[row] = of_height(j, i);
        int column = 0;
        for (int k = 0; k <= kDegree; ++k)
          for (int l = 0; k + l <= kDegree; ++l) H(row, column++) = of_weight(j + l, i + k);
      }
    }
    const Terms form = H.ldlt().solve(g);
    if (!form.allFinite()) return 0;
    Eigen::Matrix<double, kDegree + 1, kDegree + 1> coefficient = decltype(coefficient)::Zero();
    row = 0;
    for (int i = 0; i <= kDegree; ++i)
      for (int j = 0; i + j <= kDegree; ++j) coefficient(j, i) = form[row++];
    Eigen::Matrix<double, kDegree + 1, Eigen::Dynamic, Eigen::RowMajor, kDegree + 1, kAxisMax> of_s(kDegree + 1,
                                                                                                    heights.cols());
    of_s.noalias() = coefficient.lazyProduct(across.leftCols<kDegree + 1>().matrix().transpose());
    heights.matrix().noalias() -= along.leftCols<kDegree + 1>().matrix().lazyProduct(of_s);
    const double limit = kOutlierSigmas * robust_sigma_of(heights, weight);
    weight = (heights.abs() <= limit).cast<double>() * present;
    left = static_cast<std::size_t>(weight.sum());
  }
  heights *= weight;
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
  Spectrum(const CellGrid& grid, const Field& heights)
      : across_(2.0 * grid.region.cell_mm * static_cast<double>(grid.columns)),
        along_(2.0 * grid.region.cell_mm * static_cast<double>(grid.rows)) {
    columns_ = modes(across_);
    rows_ = modes(along_);
    amplitude_.resize(static_cast<Eigen::Index>(rows_) + 1, static_cast<Eigen::Index>(columns_) + 1);
    sum_products(cosines(grid.rows, rows_), heights, cosines(grid.columns, columns_), amplitude_);
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
  /// the variance of a cell with white noise of that density; at most kBeyondLongest times that of the longest modes.
  /// NaN if a ring has no modes.
  [[nodiscard]] double at_infinity() const {
    constexpr double kBeyondLongest = 4.0;
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
    if (!(reciprocal.slope() > 0.0)) return 1.0 / reciprocal.mean();
    // Steep spectra, of texture rather than of noise, reach 0 before the end.
    return 1.0 / std::fmax(reciprocal.value_at(0.0), 1.0 / (kBeyondLongest * level[0]));
  }

 private:
  static std::size_t modes(double twice_length_mm) {
    return std::min(static_cast<std::size_t>(twice_length_mm / kWavelengthMin_mm), std::size_t{kModesMax});
  }
  /// cos(p pi (i + 1/2) / n) for p = 0..count, by the angle addition rule.
  static Table cosines(std::size_t n, std::size_t count) {
    Table c(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(count) + 1);
    for (Eigen::Index i = 0; i < c.rows(); ++i) {
      const double one = std::cos(kPi * (static_cast<double>(i) + 0.5) / static_cast<double>(n));
      c(i, 0) = 1.0;
      for (Eigen::Index p = 1; p < c.cols(); ++p) c(i, p) = p == 1 ? one : 2.0 * one * c(i, p - 1) - c(i, p - 2);
    }
    return c;
  }
  /// Square of the wave number of a mode (1/mm^2), and its energy (mm^2).
  [[nodiscard]] double k2(std::size_t p, std::size_t q) const {
    const double kx = static_cast<double>(p) / across_;
    const double ks = static_cast<double>(q) / along_;
    return kx * kx + ks * ks;
  }
  [[nodiscard]] double energy(std::size_t p, std::size_t q) const {
    const double a = amplitude_(static_cast<Eigen::Index>(q), static_cast<Eigen::Index>(p));
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
  /// A row for each mode along the seat.
  Rows<kModesMax + 1> amplitude_;
};

}  // namespace

CellNoise noise_of_cells(const CellGrid& grid, std::span<const double> heights, std::span<const std::uint32_t> cells,
                         double within_variance_mm2, double points_per_cell) {
  CellNoise noise;
  if (heights.size() < kCellsMin || grid.cells() > limits::kFlatnessCellsMax ||
      std::max(grid.columns, grid.rows) > std::size_t{kAxisMax} || !(points_per_cell >= 1.0) ||
      2.0 * std::fmin(grid.region.half_x_mm, grid.region.half_s_mm) < kWavelengthMax_mm)
    return noise;
  std::array<double, limits::kFlatnessCellsMax> height_room;
  std::array<double, limits::kFlatnessCellsMax> weight_room;
  const auto rows = static_cast<Eigen::Index>(grid.rows);
  const auto columns = static_cast<Eigen::Index>(grid.columns);
  Field field(height_room.data(), rows, columns);
  Field weight(weight_room.data(), rows, columns);
  field.setZero();
  weight.setZero();
  for (std::size_t i = 0; i < heights.size(); ++i) {
    field.data()[cells[i]] = heights[i];
    weight.data()[cells[i]] = 1.0;
  }
  const std::size_t left = remove_form(grid, field, weight);
  if (left < kCellsMin) return noise;
  // Empty and excluded cells have height zero: the energies lack their part.
  const double present = static_cast<double>(left) / static_cast<double>(grid.cells());
  const Spectrum spectrum(grid, field);
  const double density = spectrum.at_infinity() / present;
  // The sum of all energies is that of the squared heights; the long ones are replaced by the noise density there.
  double long_modes = 0.0;
  const double noise_energy = field.square().sum() - spectrum.form_energy(long_modes);
  const double cell_variance = (noise_energy / present + long_modes * density) / static_cast<double>(grid.cells());
  const double point_variance = cell_variance + (1.0 - 1.0 / points_per_cell) * within_variance_mm2;
  if (!(cell_variance > 0.0) || !(point_variance > 0.0)) return noise;
  noise.ok = true;
  noise.cell_sigma_mm = std::sqrt(cell_variance);
  noise.point_sigma_mm = std::sqrt(point_variance);
  noise.factor = std::fmax(density * points_per_cell / point_variance, 1.0);
  return noise;
}

double expected_range(std::size_t count) {
  if (count < 2) return 0.0;
  // Upper tail beyond the expected maximum; the normal quantile by Newton's method on its logarithm.
  const double tail = -std::expm1(std::log(0.5264) / static_cast<double>(count));
  double z = std::sqrt(std::fmax(-2.0 * std::log(2.0 * tail), 0.01));
  for (int i = 0; i < 50; ++i) {
    const double q = 0.5 * std::erfc(z / std::sqrt(2.0));
    const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * kPi);
    z += (std::log(q) - std::log(tail)) * q / density;
  }
  return 2.0 * z;
}

// Problem: a scanner that returns an earlier exposure again, in another format, order or pose, shows a block that is
// not at the station. Equal points are found by a checksum; this finds equal noise.
//
// Idea: features common to two exposures are smooth over a few cells: the block's form and texture, the scanner's
// ripple and lens error. Noise is not. So the mean heights of 4 x 4 cells are differenced three times along both axes,
//
//     d = sum_ij k_i k_j h_ij,    k = 1, -3, 3, -1,
//
// which removes every surface of second degree in x or s exactly. Of a wave of length L the part (2 sin(pi cell / L))^6
// remains: 0.2 % of the amplitude at L = 8 mm, while white noise grows by 20. Only the sign of d is kept, so that a
// pore, a grain of dust or an outlier counts no more than any other place. Signs are compared place by place in the
// block's frame: registration repeats to a hundredth of a millimetre, a fiftieth of a cell.
//
// A scan without noise is not compared: d below kFlat_mm is the rounding of its float coordinates.

namespace {

/// Points further than this from the seat are not its noise: outliers, damage, an edge.
constexpr float kReach_mm = 0.5F;
constexpr float kUnitsPerMm = 1e5F;
/// A cell with more points than this is left out: its sum could overflow.
constexpr std::uint32_t kCellPointsMax = 32'768;
static_assert(kCellPointsMax * kReach_mm * kUnitsPerMm < 2e9F);
/// Float coordinates of 1 m are rounded to 0.06 um, which contributes up to 0.5 um to d.
constexpr double kFlat_mm = 0.002;
/// Points per mm^2 from which the fine grid is used: four per cell, and a few per cent of cells with one.
constexpr double kFineDensity = 12.0;
constexpr std::array<double, 4> kThird = {1.0, -3.0, 3.0, -1.0};

void sum_up(std::span<const SeatPoints> runs, const CellLayout& layout, std::span<NoiseCell> cells) {
  std::fill(cells.begin(), cells.end(), NoiseCell{});
  std::array<std::int32_t, kCellGroup> cell;
  std::array<float, kCellGroup> height;
  for (const SeatPoints& run : runs) {
    for (std::size_t at = 0; at < run.size(); at += kCellGroup) {
      const std::size_t count = std::min(kCellGroup, run.size() - at);
      place_in_cells({run.x.subspan(at, count), run.s.subspan(at, count), run.h.subspan(at, count)}, layout, cell,
                     height);
      for (std::size_t i = 0; i < count; ++i) {
        if (!(std::abs(height[i]) < kReach_mm)) continue;
        NoiseCell& sum = cells[static_cast<std::size_t>(cell[i])];
        if (sum.points < kCellPointsMax)
          sum.height += static_cast<std::int32_t>(std::floor(height[i] * kUnitsPerMm + 0.5F));
        ++sum.points;
      }
    }
  }
}

/// Writes the signs of all places. Returns the number of known ones.
template <typename Signs>
std::uint32_t take_signs(const CellLayout& layout, std::span<const NoiseCell> cells, Signs& signs) {
  const auto columns = static_cast<std::size_t>(layout.columns);
  std::uint32_t known = 0;
  std::array<std::array<double, limits::kNoiseWindowX_mm * 2>, 4> mean;
  std::array<std::array<bool, limits::kNoiseWindowX_mm * 2>, 4> seen;
  // Points outside the window are counted in its border, which is left out.
  for (std::size_t r = 1; r + 1 < Signs::kRows; ++r) {
    for (std::size_t i = 0; i < 4; ++i) {
      const NoiseCell* row = &cells[(2 * r + i) * columns];
      for (std::size_t c = 0; c < columns; ++c) {
        seen[i][c] = row[c].points > 0 && row[c].points < kCellPointsMax;
        mean[i][c] = seen[i][c] ? static_cast<double>(row[c].height) / static_cast<double>(row[c].points) : 0.0;
      }
    }
    for (std::size_t c = 1; c + 1 < Signs::kColumns; ++c) {
      bool all = true;
      double d = 0.0;
      for (std::size_t i = 0; i < 4; ++i) {
        double of_row = 0.0;
        for (std::size_t j = 0; j < 4; ++j) {
          all = all && seen[i][2 * c + j];
          of_row += kThird[j] * mean[i][2 * c + j];
        }
        d += kThird[i] * of_row;
      }
      if (!all || std::abs(d) < kFlat_mm * static_cast<double>(kUnitsPerMm)) continue;
      signs.set(r * Signs::kColumns + c, d > 0.0);
      ++known;
    }
  }
  return known;
}

}  // namespace

void make_noise_print(std::span<const SeatPoints> runs, const SeatFrame& frame, const PlaneFit& seat,
                      const FlatnessRegion& region, std::span<NoiseCell> cells, Team& team, NoisePrint& out) {
  out = {};
  CellLayout layout;
  layout.half_x_mm = static_cast<float>(limits::kNoiseWindowX_mm) / 2.0F;
  layout.half_s_mm = static_cast<float>(limits::kNoiseWindowS_mm) / 2.0F;
  layout.by_x = static_cast<float>(seat.normal.dot(frame.along_rail));
  layout.by_s = static_cast<float>(seat.normal.dot(frame.along_seat));
  layout.by_h = static_cast<float>(seat.normal.dot(frame.up));
  layout.offset_mm = static_cast<float>(seat.normal.dot(frame.origin) - seat.offset_mm);
  if (!(layout.by_h > 0.5F)) return;
  const auto with_cells = [&](double cell_mm) {
    CellLayout cells_of = layout;
    cells_of.cells_per_mm = static_cast<float>(1.0 / cell_mm);
    cells_of.columns = static_cast<std::int32_t>(static_cast<double>(limits::kNoiseWindowX_mm) / cell_mm);
    cells_of.rows = static_cast<std::int32_t>(static_cast<double>(limits::kNoiseWindowS_mm) / cell_mm);
    return cells_of;
  };
  std::size_t points = 0;
  for (const SeatPoints& run : runs) points += run.size();
  const double density = static_cast<double>(points) / (4.0 * region.half_x_mm * region.half_s_mm);
  std::uint32_t coarse = 0;
  team.run(density >= kFineDensity ? 2 : 1, [&](std::size_t which) {
    if (which == 0) {
      const std::span<NoiseCell> own = cells.subspan(kNoiseFineCells, kNoiseCoarseCells);
      sum_up(runs, with_cells(0.75), own);
      coarse = take_signs(with_cells(0.75), own, out.coarse);
    } else {
      const std::span<NoiseCell> own = cells.first(kNoiseFineCells);
      sum_up(runs, with_cells(0.5), own);
      static_cast<void>(take_signs(with_cells(0.5), own, out.fine));
    }
  });
  // With fewer places the print cannot be compared.
  if (coarse < limits::kNoisePlacesMin)
    out = {};
  else
    out.places = coarse;
}

namespace {

constexpr std::size_t kStrips = 3;
constexpr double kStrip_mm = 34.0;
constexpr double kBin_mm = 0.75;
constexpr std::size_t kBins = 240;
/// Half of the window of the moving average that is subtracted: 12.75 mm, more than the longest period.
constexpr std::size_t kHalf = 8;
constexpr std::uint32_t kPointsMin = 8;
constexpr std::size_t kLooked = 65'536;
/// Points are taken in rows of this length, which is not a multiple of the scan's line step.
constexpr std::size_t kRow = 61;
/// Minimum number of seen bins in a window.
constexpr std::size_t kWindowMin = 12;
/// Minimum number of such bins.
constexpr std::size_t kSeenMin = 100;
/// Squared median size over the variance, for a normal distribution; for a sine it is 1.
constexpr double kNoiseShare = 0.455;

struct Bin {
  double sum = 0.0;
  double squares = 0.0;
  std::uint32_t count = 0;
  [[nodiscard]] bool seen() const { return count >= kPointsMin; }
  [[nodiscard]] double mean() const { return sum / count; }
  /// Variance of the mean.
  [[nodiscard]] double variance() const {
    return std::max(squares - sum * sum / count, 0.0) / (static_cast<double>(count) * (count - 1));
  }
};

}  // namespace

double ripple_amplitude_mm(const ListedPoints& seat) {
  std::array<std::array<Bin, kBins>, kStrips> bins{};
  const std::size_t stride = 1 + seat.size() / kLooked;
  std::size_t row = 0;
  for (const SeatPoints& run : seat.runs)
    for (std::size_t first = 0; first < run.size(); first += kRow, ++row) {
      if (row % stride != 0) continue;
      // Neighbours share a bin, whose sums stay in registers.
      Bin* own = &bins[0][0];
      Bin sums = *own;
      for (std::size_t i = first; i < std::min(first + kRow, run.size()); ++i) {
        const double across = static_cast<double>(run.x[i]) / kStrip_mm + 0.5 * static_cast<double>(kStrips);
        const double along = static_cast<double>(run.s[i]) / kBin_mm + 0.5 * static_cast<double>(kBins);
        if (!(across >= 0.0 && along >= 0.0) || across >= static_cast<double>(kStrips) ||
            along >= static_cast<double>(kBins))
          continue;
        Bin& bin = bins[static_cast<std::size_t>(across)][static_cast<std::size_t>(along)];
        if (&bin != own) {
          *own = sums;
          own = &bin;
          sums = bin;
        }
        const auto h = static_cast<double>(run.h[i]);
        sums.sum += h;
        sums.squares += h * h;
        ++sums.count;
      }
      *own = sums;
    }
  std::array<double, kStrips * kBins> sizes;
  std::array<double, kStrips * kBins> noise;
  std::size_t seen = 0;
  for (const auto& strip : bins)
    for (std::size_t k = kHalf; k + kHalf < kBins; ++k) {
      if (!strip[k].seen()) continue;
      double sum = 0.0;
      std::size_t count = 0;
      for (std::size_t i = k - kHalf; i <= k + kHalf; ++i) {
        if (!strip[i].seen()) continue;
        sum += strip[i].mean();
        ++count;
      }
      if (count < kWindowMin) continue;
      sizes[seen] = std::abs(strip[k].mean() - sum / static_cast<double>(count));
      noise[seen++] = strip[k].variance();
    }
  if (seen < kSeenMin) return 0.0;
  const double typical = median_of(std::span(sizes).first(seen));
  const double of_noise = kNoiseShare * median_of(std::span(noise).first(seen));
  return std::sqrt(2.0 * std::max(typical * typical - of_noise, 0.0));
}

}  // namespace slabd::algo
