// SPDX-License-Identifier: Apache-2.0
//
// Correlation of the noise of two scans (base/noise_print.h), on both sides of kSameExposure. Different exposures have
// everything in common that is possible on a line; the same exposure is delivered again in another form. The scans are
// the seat's evaluation region at the density of a quarter scan, of a real scanner (0.255 mm) and of a full scan.
// Surfaces and scanner errors are those of a cast block and a fringe-projection scanner: grain of 0.010 mm rms that is
// correlated over 2 mm, pores, dust, a periodic error of 0.010 mm along one axis, a bent field, dropouts. Strength 3
// is three times as much. Noise is either correlated over 2 x 2 pixels (0.013 mm) or white (0.030 mm).
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "algo/algo.h"
#include "algo/features/seat_noise.h"
#include "base/prng.h"
#include "emulator/slab_scene.h"
#include "tests/accuracy/studies.h"

namespace slabd::accuracy {
namespace {

using emulator::derived_seed;

constexpr double kHalfX = 51.0;
constexpr double kHalfS = 75.0;

/// Heights of a seat relative to its plane, on a raster of 0.1 mm.
class Texture {
 public:
  Texture(double strength, std::uint64_t seed) : heights_(kColumns * kRows), random_(seed) {
    add_grain(0.010 * strength, 2.0);
    const auto dust = static_cast<int>(40.0 * strength);
    for (int i = 0; i < dust; ++i) {
      const double width = 0.1 + 0.4 * random_.uniform();
      add_disc(width, width);
    }
    const auto pores = static_cast<int>(10.0 * strength);
    for (int i = 0; i < pores; ++i) {
      const double width = std::clamp(std::exp(0.55 * random_.normal()), 0.5, 8.0);
      add_disc(width, -0.35 * width);
    }
  }
  [[nodiscard]] double at(double x_mm, double s_mm) const {
    const auto column = std::clamp(static_cast<int>((x_mm + kHalfX + 2.0) * 10.0), 0, kColumns - 1);
    const auto row = std::clamp(static_cast<int>((s_mm + kHalfS + 2.0) * 10.0), 0, kRows - 1);
    return static_cast<double>(heights_[index(column, row)]);
  }

 private:
  static constexpr int kColumns = 1060;
  static constexpr int kRows = 1540;
  static std::size_t index(int column, int row) {
    return static_cast<std::size_t>(row) * kColumns + static_cast<std::size_t>(column);
  }
  /// Adds white noise through a Gaussian filter: the correlation of two heights is exp(-(r / length)^2).
  void add_grain(double rms_mm, double length_mm) {
    const double sigma = 5.0 * length_mm;
    const int reach = static_cast<int>(3.0 * sigma);
    std::vector<float> kernel;
    double squares = 0.0;
    for (int i = -reach; i <= reach; ++i) {
      kernel.push_back(static_cast<float>(std::exp(-i * i / (2.0 * sigma * sigma))));
      squares += static_cast<double>(kernel.back()) * static_cast<double>(kernel.back());
    }
    for (float& k : kernel) k = static_cast<float>(static_cast<double>(k) / std::sqrt(squares));
    std::vector<float> white(heights_.size());
    for (float& h : white) h = static_cast<float>(random_.normal());
    std::vector<float> rows(heights_.size());
    for (int r = 0; r < kRows; ++r)
      for (int c = 0; c < kColumns; ++c)
        for (int k = -reach; k <= reach; ++k)
          rows[index(c, r)] +=
              kernel[static_cast<std::size_t>(k + reach)] * white[index((c + k + kColumns) % kColumns, r)];
    for (int r = 0; r < kRows; ++r)
      for (int k = -reach; k <= reach; ++k) {
        const float weight = static_cast<float>(rms_mm) * kernel[static_cast<std::size_t>(k + reach)];
        const int from = (r + k + kRows) % kRows;
        for (int c = 0; c < kColumns; ++c) heights_[index(c, r)] += weight * rows[index(c, from)];
      }
  }
  void add_disc(double width_mm, double height_mm) {
    const double at_c = kColumns * random_.uniform();
    const double at_r = kRows * random_.uniform();
    const double radius = 5.0 * width_mm;
    for (int r = std::max(0, static_cast<int>(at_r - radius));
         r <= std::min(kRows - 1, static_cast<int>(at_r + radius)); ++r)
      for (int c = std::max(0, static_cast<int>(at_c - radius));
           c <= std::min(kColumns - 1, static_cast<int>(at_c + radius)); ++c)
        if (std::hypot(c - at_c, r - at_r) < radius) heights_[index(c, r)] += static_cast<float>(height_mm);
  }

  std::vector<float> heights_;
  Prng random_;
};

struct Scanner {
  const char* name;
  double pitch_x_mm;
  double pitch_s_mm;
  double noise_mm;
  bool correlated;  ///< half of the noise is shared by 2 x 2 pixels
};

/// The region on the scanner's grid; missing points are NaN.
struct Patch {
  std::size_t width = 0;
  std::size_t height = 0;
  std::vector<double> x, s, h;
  [[nodiscard]] double& h_at(std::size_t column, std::size_t row) { return h[row * width + column]; }
  [[nodiscard]] double h_at(std::size_t column, std::size_t row) const { return h[row * width + column]; }
};

/// Draws a scan. `off_mm`: shift of the scanner's grid against the block; the scanner's errors move with the grid.
Patch expose(const Scanner& scanner, const Texture& texture, double strength, double off_mm, std::uint64_t seed) {
  Prng random(seed);
  Patch patch;
  patch.width = static_cast<std::size_t>((2.0 * kHalfX + 2.0) / scanner.pitch_x_mm);
  patch.height = static_cast<std::size_t>((2.0 * kHalfS + 2.0) / scanner.pitch_s_mm);
  std::vector<double> shared((patch.width / 2 + 1) * (patch.height / 2 + 1));
  for (double& n : shared) n = random.normal();
  for (std::size_t r = 0; r < patch.height; ++r) {
    for (std::size_t c = 0; c < patch.width; ++c) {
      const double x = static_cast<double>(c) * scanner.pitch_x_mm - kHalfX - 1.0;
      const double s = static_cast<double>(r) * scanner.pitch_s_mm - kHalfS - 1.0;
      const double own = random.normal();
      const double noise =
          scanner.correlated ? std::sqrt(0.5) * (own + shared[r / 2 * (patch.width / 2 + 1) + c / 2]) : own;
      const double ripple = 0.010 * strength * std::sin(2.0 * kPi * s / 3.0);
      const double lens = 0.012 * strength * (x / kHalfX) * (s / kHalfS) * (s / kHalfS);
      const bool seen = random.uniform() >= 0.015;
      patch.x.push_back(x + off_mm);
      patch.s.push_back(s + off_mm);
      patch.h.push_back(seen ? texture.at(x + off_mm, s + off_mm) + scanner.noise_mm * noise + ripple + lens
                             : kNoValue);
    }
  }
  return patch;
}

enum class Form : std::uint8_t {
  same,
  reversed,
  rounded,
  mean,
  median,
  decimated,
  mean_decimated,
  // Beyond these recognition is not promised; the study shows where it ends.
  mean_5,
  median_5,
  mean_7,
  every_third,
  rounded_coarsely
};
struct NamedForm {
  Form form;
  const char* name;
};
constexpr std::array kForms = {NamedForm{Form::same, "points as they are, registered again"},
                               NamedForm{Form::reversed, "in reverse order"},
                               NamedForm{Form::rounded, "rounded to 0.01 mm"},
                               NamedForm{Form::mean, "mean of 3 x 3"},
                               NamedForm{Form::median, "median of 3 x 3"},
                               NamedForm{Form::decimated, "every second row and column"},
                               NamedForm{Form::mean_decimated, "mean of 3 x 3, every second row and column"},
                               NamedForm{Form::mean_5, "mean of 5 x 5"},
                               NamedForm{Form::median_5, "median of 5 x 5"},
                               NamedForm{Form::mean_7, "mean of 7 x 7"},
                               NamedForm{Form::every_third, "every third row and column"},
                               NamedForm{Form::rounded_coarsely, "rounded to 0.1 mm"}};
constexpr Form kLastRecognised = Form::mean_decimated;

/// Mean or median of the (2 `reach` + 1)^2 neighbours of each point that are there.
Patch filtered(const Patch& from, bool median, std::size_t reach = 1) {
  Patch to = from;
  for (std::size_t r = reach; r + reach < from.height; ++r) {
    for (std::size_t c = reach; c + reach < from.width; ++c) {
      std::array<double, 49> near{};
      std::size_t n = 0;
      for (std::size_t i = r - reach; i <= r + reach; ++i)
        for (std::size_t j = c - reach; j <= c + reach; ++j)
          if (has_value(from.h_at(j, i))) near[n++] = from.h_at(j, i);
      if (n == 0) continue;
      double sum = 0.0;
      for (std::size_t k = 0; k < n; ++k) sum += near[k];
      std::sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(n));
      to.h_at(c, r) = median ? near[n / 2] : sum / static_cast<double>(n);
    }
  }
  return to;
}

Patch decimated(const Patch& from, std::size_t kept_of = 2) {
  Patch to = from;
  for (std::size_t r = 0; r < from.height; ++r)
    for (std::size_t c = 0; c < from.width; ++c)
      if (r % kept_of != 0 || c % kept_of != 0) to.h_at(c, r) = kNoValue;
  return to;
}

void round_to(double step_mm, Patch& patch) {
  for (std::vector<double>* values : {&patch.x, &patch.s, &patch.h})
    for (double& v : *values) v = std::round(v / step_mm) * step_mm;
}

Patch exported(const Patch& patch, Form form) {
  Patch to = patch;
  switch (form) {
    case Form::same: break;
    case Form::reversed:
      std::reverse(to.x.begin(), to.x.end());
      std::reverse(to.s.begin(), to.s.end());
      std::reverse(to.h.begin(), to.h.end());
      break;
    case Form::rounded: round_to(0.01, to); break;
    case Form::rounded_coarsely: round_to(0.1, to); break;
    case Form::mean: return filtered(patch, false);
    case Form::median: return filtered(patch, true);
    case Form::decimated: return decimated(patch);
    case Form::mean_decimated: return decimated(filtered(patch, false));
    case Form::mean_5: return filtered(patch, false, 2);
    case Form::median_5: return filtered(patch, true, 2);
    case Form::mean_7: return filtered(patch, false, 3);
    case Form::every_third: return decimated(patch, 3);
  }
  return to;
}

class Printer {
 public:
  /// Noise print with a registration error of up to 0.02 mm and 0.1 mrad.
  [[nodiscard]] NoisePrint print(const Patch& patch, std::uint64_t seed) {
    Prng random(seed);
    const auto within = [&](double amplitude) { return amplitude * (2.0 * random.uniform() - 1.0); };
    const double dx = within(0.02);
    const double ds = within(0.02);
    const double turn = within(1e-4);
    x_.clear();
    s_.clear();
    h_.clear();
    for (std::size_t i = 0; i < patch.h.size(); ++i) {
      const double x = patch.x[i] - turn * patch.s[i] + dx;
      const double s = patch.s[i] + turn * patch.x[i] + ds;
      if (!has_value(patch.h[i]) || std::abs(x) > kHalfX || std::abs(s) > kHalfS) continue;
      x_.push_back(static_cast<float>(x));
      s_.push_back(static_cast<float>(s));
      h_.push_back(static_cast<float>(patch.h[i] + turn * x));
    }
    PlaneFit seat;
    seat.normal = Vec3::UnitZ();
    seat.offset_mm = 0.0;
    const std::array runs = {algo::SeatPoints{x_, s_, h_}};
    NoisePrint print;
    algo::make_noise_print(runs, {}, seat, {kHalfX, kHalfS, 1.5, 12}, cells_, team_, print);
    return print;
  }

 private:
  Team team_{1};
  std::vector<float> x_, s_, h_;
  std::vector<algo::NoiseCell> cells_ = std::vector<algo::NoiseCell>(algo::kNoiseCells);
};

struct Correlations {
  std::vector<double> values;

  void add(const NoisePrint& a, const NoisePrint& b) { values.push_back(noise_correlation(a, b)); }
  void add_all_pairs(const std::vector<NoisePrint>& prints) {
    for (std::size_t i = 0; i < prints.size(); ++i)
      for (std::size_t j = 0; j < i; ++j) add(prints[i], prints[j]);
  }
  [[nodiscard]] double sigma() const {
    const double m = mean(values);
    double squares = 0.0;
    for (const double v : values) squares += (v - m) * (v - m);
    return std::sqrt(squares / static_cast<double>(values.size() - 1));
  }
  [[nodiscard]] double share_recognised() const {
    const auto count = std::count_if(values.begin(), values.end(), [](double v) { return v >= kSameExposure; });
    return static_cast<double>(count) / static_cast<double>(values.size());
  }
  /// Expected false alarms of a scan that is compared with all stored prints, for normally distributed correlations.
  [[nodiscard]] double false_alarms() const {
    const double z = (kSameExposure - mean(values)) / sigma();
    return static_cast<double>(limits::kNoisePrintsKept) * 0.5 * std::erfc(z / std::sqrt(2.0));
  }
};

constexpr double kFalseAlarmsMax = 1e-6;

void judge_different(Table& table, const std::string& what, const Correlations& correlations) {
  table.tell(what + ": mean", mean(correlations.values), "");
  table.tell(what + ": standard deviation", correlations.sigma(), "");
  table.at_most(what + ": largest of " + std::to_string(correlations.values.size()), largest(correlations.values),
                kSameExposure, "");
  table.at_most(what + ": false alarms per scan", correlations.false_alarms(), kFalseAlarmsMax, "");
}

}  // namespace

bool exposures_study(const StudyOptions& options, Table& table) {
  const std::array scanners = {Scanner{"quarter, 0.013 mm", 0.342, 0.409, 0.013, true},
                               Scanner{"quarter, 0.030 mm", 0.342, 0.409, 0.030, false},
                               Scanner{"0.255 mm, 0.013 mm", 0.255, 0.255, 0.013, true},
                               Scanner{"0.255 mm, 0.030 mm", 0.255, 0.255, 0.030, false},
                               Scanner{"full, 0.013 mm", 0.171, 0.204, 0.013, true},
                               Scanner{"full, 0.030 mm", 0.171, 0.204, 0.030, false}};
  const int scans = options.cases(60, 12);
  constexpr std::uint64_t kBlocks = 6;
  std::vector<Texture> usual;
  std::vector<Texture> rough;
  for (std::uint64_t k = 0; k < kBlocks; ++k) {
    usual.emplace_back(1.0, derived_seed(options.first, 40, k));
    rough.emplace_back(3.0, derived_seed(options.first, 41, k));
  }
  Printer printer;
  for (std::size_t which = 0; which < scanners.size(); ++which) {
    const Scanner& scanner = scanners[which];
    Correlations blocks;
    Correlations rescans;
    Correlations rough_rescans;
    std::vector<Correlations> forms(kForms.size());
    std::vector<NoisePrint> of_blocks;
    std::vector<NoisePrint> of_one;
    std::vector<NoisePrint> of_rough;
    for (int i = 0; i < scans; ++i) {
      const auto k = static_cast<std::uint64_t>(i);
      const auto seed = [&](std::uint64_t purpose) {
        return derived_seed(options.first, 50 + 10 * which + purpose, k);
      };
      // Half of the scans are from exactly the same pose.
      const double off_mm = i % 2 == 0 ? 0.0 : 2.0 * Prng(seed(0)).uniform() - 1.0;
      const Patch of_block = expose(scanner, usual[k % kBlocks], 1.0, off_mm, seed(1));
      if (k < kBlocks) of_blocks.push_back(printer.print(of_block, seed(2)));
      of_one.push_back(printer.print(expose(scanner, usual[0], 1.0, off_mm, seed(3)), seed(4)));
      of_rough.push_back(printer.print(expose(scanner, rough[0], 3.0, off_mm, seed(5)), seed(6)));
      for (std::size_t other = 1; other < of_blocks.size(); ++other) blocks.add(of_blocks[other], of_one.back());
      if (i % 4 != 0) continue;
      const NoisePrint first = printer.print(of_block, seed(7));
      for (std::size_t f = 0; f < kForms.size(); ++f)
        forms[f].add(first, printer.print(exported(of_block, kForms[f].form), seed(8)));
    }
    rescans.add_all_pairs(of_one);
    rough_rescans.add_all_pairs(of_rough);
    const std::string name = scanner.name;
    judge_different(table, name + ", other blocks", blocks);
    judge_different(table, name + ", the same block again", rescans);
    judge_different(table, name + ", the same rough block again", rough_rescans);
    for (std::size_t f = 0; f < kForms.size(); ++f) {
      const std::string what = name + ", the same exposure, " + kForms[f].name;
      const double least = quantile(forms[f].values, 0.0);
      if (kForms[f].form <= kLastRecognised) {
        table.at_least(what + ": least", least, kSameExposure, "");
        continue;
      }
      table.tell(what + ": least", least, "");
      table.tell(what + ": share recognised", forms[f].share_recognised(), "");
    }
  }
  table.tell("refused from this correlation on", kSameExposure, "");
  return true;
}

}  // namespace slabd::accuracy
