// SPDX-License-Identifier: Apache-2.0
//
// Steps: values by cell (one mould at one place); location and variance of each cell; additive two-way fit of the
// cells; each cell against the centre of the other moulds; drift.
#include "cli/mould/model.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <span>

#include "cli/study/statistics.h"

namespace slabd::cli::mould {
namespace {

constexpr double kHuber = 1.5;
/// Variance of Huber's estimate with k = 1.5, relative to the mean of a normal sample.
constexpr double kHuberCost = 1.037;
constexpr double kReject = 4.0;
/// Normal standard deviation per median absolute deviation.
constexpr double kMad = 1.4826;
/// Variance of a median relative to a mean.
constexpr double kMedianCost = 1.5708;
/// A smaller scatter, in mm or degrees, is not believed.
constexpr double kScatterMin = 1e-6;
/// Lower limit of a centre's variance relative to the assumed one, which deviating moulds make too large.
constexpr double kCostMin = 0.3;
constexpr int kCellRounds = 4;
constexpr int kPolishRounds = 10;
constexpr int kFitRounds = 30;

double median_of(std::vector<double>& values) {
  if (values.empty()) return kNoValue;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

double square(double x) {
  return x * x;
}

/// Values of one mould at one place, in the order of casting.
struct Cell {
  std::span<const double> values;
  std::span<const double> days;
  double location = kNoValue;
  double scale = kNoValue;     ///< standard deviation of a value
  double variance = kNoValue;  ///< of `location`
  double nu = kNoValue;        ///< degrees of freedom of `variance`

  [[nodiscard]] std::size_t n() const { return values.size(); }
};

struct Cells {
  std::vector<double> values;  ///< by cell
  std::vector<double> days;
  std::vector<Cell> list;  ///< [row * places + place]
  double pool = kNoValue;  ///< typical variance of a value
  /// Degrees of freedom that `pool` adds to those of a cell; infinite if the cells have one variance.
  double pool_nu = 0.0;
  double nu_max = 1.0;  ///< degrees of freedom of all values together
};

Cells by_cell(const Observations& observations) {
  const std::size_t count = observations.mould.size() * observations.places;
  const auto cell_of = [&](const Observation& o) { return o.row * observations.places + o.place; };
  std::vector<std::size_t> begin(count + 1, 0);
  for (const Observation& o : observations.values)
    if (std::isfinite(o.value)) ++begin[cell_of(o) + 1];
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  Cells cells;
  cells.values.resize(begin.back());
  cells.days.resize(begin.back());
  std::vector<std::size_t> next(begin.begin(), begin.end() - 1);
  for (const Observation& o : observations.values) {
    if (!std::isfinite(o.value)) continue;
    const std::size_t at = next[cell_of(o)]++;
    cells.values[at] = o.value;
    cells.days[at] = o.day;
  }
  cells.list.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t n = begin[i + 1] - begin[i];
    cells.list[i].values = std::span<const double>(cells.values).subspan(begin[i], n);
    cells.list[i].days = std::span<const double>(cells.days).subspan(begin[i], n);
  }
  return cells;
}

/// Huber's estimate of the location with a given scale.
double huber(std::span<const double> values, double start, double scale) {
  double at = start;
  for (int round = 0; round < 20; ++round) {
    double sum = 0.0;
    std::size_t inside = 0;
    for (const double value : values) {
      const double t = (value - at) / scale;
      sum += std::clamp(t, -kHuber, kHuber);
      if (std::abs(t) < kHuber) ++inside;
    }
    const double step = scale * sum / static_cast<double>(std::max<std::size_t>(inside, 1));
    at += step;
    if (std::abs(step) < 1e-4 * scale) break;
  }
  return at;
}

/// Centre of effects of which some deviate.
double centre_of(std::vector<double> effects) {
  const double middle = median_of(effects);
  std::vector<double> sizes;
  for (const double effect : effects) sizes.push_back(std::abs(effect - middle));
  const double scale = kMad * median_of(sizes);
  std::erase_if(effects, [&](double effect) { return std::abs(effect - middle) > kReject * scale; });
  return scale > 0.0 && !effects.empty() ? huber(effects, middle, scale) : middle;
}

/// Variance of the values about `location`, without those beyond kReject scales; n - 1 in the denominator.
double variance_about(std::span<const double> values, double location, double scale) {
  double squares = 0.0;
  std::size_t inside = 0;
  for (const double value : values) {
    if (std::abs(value - location) > kReject * scale) continue;
    squares += square(value - location);
    ++inside;
  }
  return inside < 2 ? 0.0 : squares / static_cast<double>(inside - 1);
}

/// x with trigamma(x) = `value`, by bisection; the function falls monotonically.
double trigamma_inverse(double value) {
  double low = 1e-3;
  double high = 1e6;
  if (value <= study::trigamma(high)) return high;
  for (int round = 0; round < 100; ++round) {
    const double middle = std::sqrt(low * high);
    (study::trigamma(middle) > value ? low : high) = middle;
  }
  return low;
}

/// Distribution of the cells' variances: a scaled inverse chi-squared one (Smyth 2004, limma). `variances` and `nus`
/// belong to cells with at least two values.
void moderate(const std::vector<double>& variances, const std::vector<double>& nus, Cells& cells) {
  double weight = 0.0;
  double mean = 0.0;
  double expected = 0.0;
  std::vector<double> logs(variances.size());
  for (std::size_t i = 0; i < variances.size(); ++i) {
    const double half = 0.5 * nus[i];
    logs[i] = std::log(std::max(variances[i], square(kScatterMin))) - study::digamma(half) + std::log(half);
    // Many values say more than few.
    const double w = 1.0 / (study::trigamma(half) + 0.1);
    weight += w;
    mean += w * logs[i];
    expected += w * study::trigamma(half);
  }
  mean /= weight;
  expected /= weight;
  double spread = 0.0;
  for (std::size_t i = 0; i < variances.size(); ++i)
    spread += square(logs[i] - mean) / (study::trigamma(0.5 * nus[i]) + 0.1);
  const auto count = static_cast<double>(variances.size());
  spread *= count / (weight * std::max(count - 1.0, 1.0));
  if (variances.size() < 3 || spread <= expected) {
    cells.pool_nu = std::numeric_limits<double>::infinity();
    // Pooled by degrees of freedom.
    double squares = 0.0;
    double nu = 0.0;
    for (std::size_t i = 0; i < variances.size(); ++i) {
      squares += nus[i] * variances[i];
      nu += nus[i];
    }
    cells.pool = squares / nu;
  } else {
    cells.pool_nu = 2.0 * trigamma_inverse(spread - expected);
    cells.pool = std::exp(mean + study::digamma(0.5 * cells.pool_nu) - std::log(0.5 * cells.pool_nu));
  }
  cells.pool = std::max(cells.pool, square(kScatterMin));
}

/// Own variance of a cell with `nu` degrees of freedom, moderated.
double moderated(const Cells& cells, double variance, double nu) {
  if (std::isinf(cells.pool_nu)) return cells.pool;
  return (cells.pool_nu * cells.pool + nu * variance) / (cells.pool_nu + nu);
}

double moderated_nu(const Cells& cells, double nu) {
  return std::max(1.0, std::min(cells.pool_nu + nu, cells.nu_max));
}

/// Locations and variances of all cells. False if no cell has two values.
bool measure(Cells& cells) {
  std::vector<double> deviations;
  double values = 0.0;
  double repeated = 0.0;
  for (Cell& cell : cells.list) {
    if (cell.n() == 0) continue;
    std::vector<double> own(cell.values.begin(), cell.values.end());
    cell.location = median_of(own);
    if (cell.n() < 2) continue;
    ++repeated;
    values += static_cast<double>(cell.n());
    const auto n = static_cast<double>(cell.n());
    for (double& value : own) value = std::abs(value - cell.location);
    cell.scale = kMad * median_of(own);
    for (const double value : own) deviations.push_back(value * std::sqrt(n / (n - 1.0)));
  }
  if (deviations.empty()) return false;
  cells.nu_max = std::max(1.0, values - repeated);
  const double pool = std::max(kScatterMin, kMad * median_of(deviations));
  for (Cell& cell : cells.list) cell.scale = cell.n() < 10 ? pool : std::max(pool, cell.scale);
  std::vector<double> variances;
  std::vector<double> nus;
  for (int round = 0; round < kCellRounds; ++round) {
    variances.clear();
    nus.clear();
    for (Cell& cell : cells.list) {
      if (cell.n() == 0) continue;
      cell.location = huber(cell.values, cell.location, cell.scale);
      if (cell.n() < 2) continue;
      variances.push_back(variance_about(cell.values, cell.location, cell.scale));
      nus.push_back(static_cast<double>(cell.n() - 1));
    }
    moderate(variances, nus, cells);
    std::size_t next = 0;
    for (Cell& cell : cells.list) {
      if (cell.n() == 0) continue;
      const double nu = static_cast<double>(cell.n() - 1);
      const double own = cell.n() < 2 ? cells.pool : variances[next++];
      const double variance = moderated(cells, own, nu);
      cell.scale = std::sqrt(std::max(variance, square(kScatterMin)));
      cell.variance = kHuberCost * square(cell.scale) / static_cast<double>(cell.n());
      cell.nu = moderated_nu(cells, nu);
    }
  }
  return true;
}

/// Additive fit of the cells: level + mould + place.
struct TwoWay {
  std::vector<char> basis;  ///< cells with at least kSlabsMin slabs; all cells if there are none
  double level = 0.0;
  std::vector<double> row;
  std::vector<double> place;
  double between = 0.0;        ///< variance of the moulds at one place, beyond that of their values
  std::vector<double> weight;  ///< Huber's weight over variance; 0: takes no part
  double cost = 1.0;           ///< variance of a centre, relative to that with weights of known variances
  double nu = 1.0;
  double level_variance = 0.0;  ///< by the scatter of the moulds' own levels
};

class TwoWayFit {
 public:
  TwoWayFit(const Cells& cells, std::size_t rows, std::size_t places)
      : cells_(cells), rows_(rows), places_(places), with_rows_(places >= kPlacesMin) {
    fit_.row.assign(rows, 0.0);
    fit_.place.assign(places, 0.0);
    fit_.weight.assign(rows * places, 0.0);
    choose_basis();
  }

  TwoWay fit() {
    polish();
    spread_between();
    for (int round = 0; round < kFitRounds; ++round) {
      weigh();
      if (improve() < 1e-3 * std::sqrt(fit_.between + typical_variance_)) break;
    }
    weigh();
    judge_centres();
    return std::move(fit_);
  }

 private:
  [[nodiscard]] const Cell& cell(std::size_t row, std::size_t place) const {
    return cells_.list[row * places_ + place];
  }
  [[nodiscard]] bool counts(std::size_t row, std::size_t place) const { return fit_.basis[row * places_ + place] != 0; }
  [[nodiscard]] double rest(std::size_t row, std::size_t place) const {
    return cell(row, place).location - fit_.level - fit_.row[row] - fit_.place[place];
  }

  void choose_basis() {
    fit_.basis.assign(rows_ * places_, 0);
    for (std::size_t i = 0; i < fit_.basis.size(); ++i) fit_.basis[i] = cells_.list[i].n() >= kSlabsMin ? 1 : 0;
    // A place that no mould has often enough uses what there is.
    for (std::size_t place = 0; place < places_; ++place) {
      bool any = false;
      for (std::size_t row = 0; row < rows_; ++row) any = any || counts(row, place);
      if (any) continue;
      for (std::size_t row = 0; row < rows_; ++row)
        fit_.basis[row * places_ + place] = cell(row, place).n() > 0 ? 1 : 0;
    }
    std::vector<double> variances;
    for (std::size_t i = 0; i < fit_.basis.size(); ++i)
      if (fit_.basis[i] != 0) variances.push_back(cells_.list[i].variance);
    typical_variance_ = median_of(variances);
    rows_used_.assign(rows_, 0);
    places_used_.assign(places_, 0);
    for (std::size_t row = 0; row < rows_; ++row)
      for (std::size_t place = 0; place < places_; ++place)
        if (counts(row, place)) rows_used_[row] = places_used_[place] = 1;
  }
  [[nodiscard]] static double count(const std::vector<char>& used) {
    return static_cast<double>(std::count(used.begin(), used.end(), char{1}));
  }

  /// Moves the centres of rows and places into the level.
  void centre() {
    if (with_rows_) shift(fit_.row, centre_of(used_of(fit_.row, rows_used_)));
    shift(fit_.place, centre_of(used_of(fit_.place, places_used_)));
  }
  [[nodiscard]] static std::vector<double> used_of(const std::vector<double>& effects, const std::vector<char>& used) {
    std::vector<double> list;
    for (std::size_t i = 0; i < effects.size(); ++i)
      if (used[i] != 0) list.push_back(effects[i]);
    return list;
  }
  void shift(std::vector<double>& effects, double by) {
    for (double& effect : effects) effect -= by;
    fit_.level += by;
  }

  /// Tukey's median polish.
  void polish() {
    std::vector<double> line;
    for (int round = 0; round < kPolishRounds; ++round) {
      for (std::size_t place = 0; place < places_; ++place) {
        line.clear();
        for (std::size_t row = 0; row < rows_; ++row)
          if (counts(row, place)) line.push_back(rest(row, place));
        if (!line.empty()) fit_.place[place] += median_of(line);
      }
      for (std::size_t row = 0; with_rows_ && row < rows_; ++row) {
        line.clear();
        for (std::size_t place = 0; place < places_; ++place)
          if (counts(row, place)) line.push_back(rest(row, place));
        if (!line.empty()) fit_.row[row] += median_of(line);
      }
      centre();
    }
  }

  [[nodiscard]] double free_cells() const {
    return std::max(1.0, count(fit_.basis) - count(places_used_) - (with_rows_ ? count(rows_used_) - 1.0 : 0.0));
  }

  /// Scatter between moulds from the median absolute rest, which few deviating moulds do not change.
  void spread_between() {
    std::vector<double> rests;
    for (std::size_t row = 0; row < rows_; ++row)
      for (std::size_t place = 0; place < places_; ++place)
        if (counts(row, place)) rests.push_back(std::abs(rest(row, place)));
    const double used = static_cast<double>(rests.size());
    const double variance = square(kMad * median_of(rests)) * used / free_cells();
    fit_.between = std::max(0.0, variance - typical_variance_);
  }

  void weigh() {
    for (std::size_t row = 0; row < rows_; ++row)
      for (std::size_t place = 0; place < places_; ++place) {
        double& weight = fit_.weight[row * places_ + place];
        weight = 0.0;
        if (!counts(row, place)) continue;
        const double variance = cell(row, place).variance + fit_.between;
        const double t = std::abs(rest(row, place)) / std::sqrt(variance);
        if (t <= kReject) weight = std::min(1.0, kHuber / std::max(t, 1e-12)) / variance;
      }
  }

  /// One round of weighted means; returns the largest change.
  double improve() {
    double change = 0.0;
    const auto mean = [&](std::size_t cells, const auto& at, double& effect) {
      double sum = 0.0;
      double weights = 0.0;
      for (std::size_t i = 0; i < cells; ++i) {
        const auto [row, place] = at(i);
        const double weight = fit_.weight[row * places_ + place];
        if (weight == 0.0) continue;
        sum += weight * rest(row, place);
        weights += weight;
      }
      if (weights == 0.0) return;
      effect += sum / weights;
      change = std::max(change, std::abs(sum / weights));
    };
    for (std::size_t place = 0; place < places_; ++place)
      mean(
          rows_, [&](std::size_t row) { return std::pair(row, place); }, fit_.place[place]);
    for (std::size_t row = 0; with_rows_ && row < rows_; ++row)
      mean(
          places_, [&](std::size_t place) { return std::pair(row, place); }, fit_.row[row]);
    centre();
    return change;
  }

  /// Standard error of the centres from the rests of all cells that take part (sandwich), and of the level.
  void judge_centres() {
    double squares = 0.0;
    double inside = 0.0;
    double used = 0.0;
    for (std::size_t row = 0; row < rows_; ++row)
      for (std::size_t place = 0; place < places_; ++place) {
        if (fit_.weight[row * places_ + place] == 0.0) continue;
        const double t = rest(row, place) / std::sqrt(cell(row, place).variance + fit_.between);
        squares += square(std::clamp(t, -kHuber, kHuber));
        inside += std::abs(t) < kHuber ? 1.0 : 0.0;
        ++used;
      }
    // Cells that were rejected do not make the result more certain.
    fit_.nu = std::max(1.0, used - (count(fit_.basis) - free_cells()));
    if (inside > 0.0) fit_.cost = std::max(kCostMin, squares / fit_.nu / square(inside / used));
    if (!with_rows_) return;
    std::vector<double> rows = used_of(fit_.row, rows_used_);
    for (double& row : rows) row = std::abs(row);
    fit_.level_variance = kMedianCost * square(kMad * median_of(rows)) / count(rows_used_);
  }

  const Cells& cells_;
  std::size_t rows_;
  std::size_t places_;
  bool with_rows_;
  std::vector<char> rows_used_;  ///< has a cell of the basis
  std::vector<char> places_used_;
  double typical_variance_ = 0.0;
  TwoWay fit_;
};

/// Signal limit in standard errors.
double limit_for(double nu) {
  return std::max(kSignal, study::student_quantile(1.0 - 0.5 * kFalseSignals, nu));
}

void set_interval(Effect& effect, double variance, double nu) {
  effect.u = std::sqrt(variance);
  effect.U = study::student_quantile(0.975, std::max(1.0, nu)) * effect.u;
}

/// Degrees of freedom of a sum of two variances (Welch and Satterthwaite).
double nu_of(double a, double nu_a, double b, double nu_b) {
  const double below = square(a) / nu_a + square(b) / nu_b;
  return below > 0.0 ? square(a + b) / below : std::min(nu_a, nu_b);
}

/// Straight line through the values of a cell over the days.
struct Line {
  double slope = kNoValue;  ///< per day
  double slope_u = kNoValue;
  double nu = 1.0;
  double per_slab = kNoValue;  ///< days from one slab to the next, mean
  double now = kNoValue;
  double now_u = kNoValue;
};

Line line_of(const Cells& cells, const Cell& cell) {
  Line line;
  if (cell.n() < kDriftSlabsMin || !(cell.days.back() > cell.days.front())) return line;
  double slope = 0.0;
  double at = cell.location;
  double day = 0.0;
  double across = 0.0;
  double scale = cell.scale;
  for (int round = 0; round < 10; ++round) {
    double w = 0.0;
    double x = 0.0;
    double y = 0.0;
    const auto weight = [&](std::size_t i) {
      const double t = std::abs(cell.values[i] - at - slope * (cell.days[i] - day)) / scale;
      return t > kReject ? 0.0 : std::min(1.0, kHuber / std::max(t, 1e-12));
    };
    std::vector<double> weights(cell.n());
    for (std::size_t i = 0; i < cell.n(); ++i) {
      weights[i] = weight(i);
      w += weights[i];
      x += weights[i] * cell.days[i];
      y += weights[i] * cell.values[i];
    }
    if (w < 3.0) return line;
    day = x / w;
    at = y / w;
    double xy = 0.0;
    across = 0.0;
    for (std::size_t i = 0; i < cell.n(); ++i) {
      xy += weights[i] * (cell.days[i] - day) * (cell.values[i] - at);
      across += weights[i] * square(cell.days[i] - day);
    }
    if (!(across > 0.0)) return line;
    slope = xy / across;
    double squares = 0.0;
    double inside = 0.0;
    for (std::size_t i = 0; i < cell.n(); ++i) {
      const double rest = cell.values[i] - at - slope * (cell.days[i] - day);
      if (std::abs(rest) > kReject * scale) continue;
      squares += square(rest);
      ++inside;
    }
    const double nu = std::max(1.0, inside - 2.0);
    scale = std::sqrt(std::max(square(kScatterMin), moderated(cells, squares / nu, nu)));
    line.nu = moderated_nu(cells, nu);
  }
  const double variance = kHuberCost * square(scale);
  line.slope = slope;
  line.slope_u = std::sqrt(variance / across);
  line.per_slab = (cell.days.back() - cell.days.front()) / static_cast<double>(cell.n() - 1);
  const double ahead = cell.days.back() - day;
  line.now = at + slope * ahead;
  line.now_u = std::sqrt(variance / static_cast<double>(cell.n()) + square(ahead * line.slope_u));
  return line;
}

void add_ewma(const Cell& cell, double centre, double centre_variance, MouldEffect& effect) {
  double at = cell.location;
  for (const double value : cell.values) at += kNewest * std::clamp(value - at, -3.0 * cell.scale, 3.0 * cell.scale);
  const double share = kNewest / (2.0 - kNewest);
  // Begun at the mean of all values, so its error is never below that of the mean.
  const double own = std::max(square(cell.scale) * share, cell.variance);
  effect.ewma = at - centre;
  effect.ewma_u = std::sqrt(own + centre_variance);
}

class Estimate {
 public:
  explicit Estimate(const Observations& observations)
      : observations_(observations), rows_(observations.mould.size()), places_(observations.places) {
    model_.places = places_;
    model_.moulds.assign(places_, 0);
    model_.mould.resize(rows_ * places_);
    if (places_ >= kPlacesMin) model_.line.resize(places_);
  }

  Model fit() {
    cells_ = by_cell(observations_);
    for (std::size_t i = 0; i < cells_.list.size(); ++i) model_.mould[i].n = cells_.list[i].n();
    count_moulds();
    for (std::size_t place = 0; place < model_.line.size(); ++place)
      for (std::size_t row = 0; row < rows_; ++row) model_.line[place].n += cells_.list[row * places_ + place].n();
    if (!measure(cells_)) return std::move(model_);
    model_.scatter = std::sqrt(cells_.pool);
    two_way_ = TwoWayFit(cells_, rows_, places_).fit();
    model_.level = two_way_.level;
    for (std::size_t place = 0; place < places_; ++place) {
      add_line(place);
      for (std::size_t row = 0; row < rows_; ++row) add_mould(row, place);
      add_drifts(place);
    }
    return std::move(model_);
  }

 private:
  void count_moulds() {
    for (std::size_t place = 0; place < places_; ++place) {
      std::set<std::uint32_t> different;
      for (std::size_t row = 0; row < rows_; ++row)
        if (cells_.list[row * places_ + place].n() >= kSlabsMin) different.insert(observations_.mould[row]);
      model_.moulds[place] = different.size();
    }
  }

  [[nodiscard]] double sum_of_weights(std::size_t place) const {
    double sum = 0.0;
    for (std::size_t row = 0; row < rows_; ++row) sum += two_way_.weight[row * places_ + place];
    return sum;
  }

  void add_line(std::size_t place) {
    if (model_.line.empty()) return;
    Effect& effect = model_.line[place];
    if (effect.n == 0) return;
    const double weights = sum_of_weights(place);
    effect.bias = two_way_.place[place];
    set_interval(effect, weights > 0.0 ? two_way_.cost / weights : disagreement(place), two_way_.nu);
    if (effect.n < kSlabsMin) return;
    const bool proven = std::abs(effect.bias) >= limit_for(two_way_.nu) * effect.u;
    effect.signal = proven && model_.separates(place) ? Signal::line : Signal::none;
  }

  /// Centre of the other moulds at a place: the fit without the own row. Without another mould the level, so that
  /// the effect contains that of the line; separates() is false.
  struct Centre {
    double at = kNoValue;
    double variance = kNoValue;
  };
  [[nodiscard]] Centre centre_without(std::size_t row, std::size_t place) const {
    double sum = 0.0;
    double weights = 0.0;
    bool alone = true;
    for (std::size_t other = 0; other < rows_; ++other) {
      if (observations_.mould[other] == observations_.mould[row]) continue;
      alone = alone && two_way_.basis[other * places_ + place] == 0;
      const double weight = two_way_.weight[other * places_ + place];
      if (weight == 0.0) continue;
      sum += weight * (cells_.list[other * places_ + place].location - two_way_.row[other]);
      weights += weight;
    }
    if (alone) return {two_way_.level, 0.0};
    if (weights == 0.0) return {two_way_.level + two_way_.place[place], disagreement(place)};
    return {sum / weights, two_way_.cost / weights + two_way_.level_variance};
  }

  /// Variance of a centre of moulds that all contradict each other: the mean square of their rests.
  [[nodiscard]] double disagreement(std::size_t place) const {
    double squares = 0.0;
    double used = 0.0;
    for (std::size_t row = 0; row < rows_; ++row) {
      const Cell& cell = cells_.list[row * places_ + place];
      if (two_way_.basis[row * places_ + place] == 0) continue;
      squares += square(cell.location - two_way_.level - two_way_.row[row] - two_way_.place[place]);
      ++used;
    }
    return used > 0.0 ? squares / used : 0.0;
  }

  void add_mould(std::size_t row, std::size_t place) {
    MouldEffect& effect = model_.mould[row * places_ + place];
    const Cell& cell = cells_.list[row * places_ + place];
    if (effect.n == 0) return;
    const Centre centre = centre_without(row, place);
    effect.bias = cell.location - centre.at;
    const double nu = nu_of(cell.variance, cell.nu, centre.variance, two_way_.nu);
    set_interval(effect, cell.variance + centre.variance, nu);
    add_ewma(cell, centre.at, centre.variance, effect);
    if (effect.n < kSlabsMin) return;
    const bool proven = std::abs(effect.bias) >= limit_for(nu) * effect.u;
    effect.signal = proven && model_.separates(place) ? Signal::mould : Signal::none;
  }

  /// A drift that all moulds have at a place is the line's: each is compared with the median.
  void add_drifts(std::size_t place) {
    std::vector<Line> lines(rows_);
    std::vector<double> slopes;
    std::vector<double> variances;
    std::set<std::uint32_t> different;
    for (std::size_t row = 0; row < rows_; ++row) {
      lines[row] = line_of(cells_, cells_.list[row * places_ + place]);
      if (!has_value(lines[row].slope)) continue;
      slopes.push_back(lines[row].slope);
      variances.push_back(square(lines[row].slope_u));
      different.insert(observations_.mould[row]);
    }
    if (different.size() < kMouldsMin) return;
    const auto count = static_cast<double>(slopes.size());
    const double typical = median_of(slopes);
    const double typical_variance = kMedianCost * median_of(variances) / count;
    for (std::size_t row = 0; row < rows_; ++row) {
      const Line& line = lines[row];
      if (!has_value(line.slope)) continue;
      MouldEffect& effect = model_.mould[row * places_ + place];
      const double own = line.slope - typical;
      const double u = std::sqrt(square(line.slope_u) + typical_variance);
      effect.drift_per_100 = 100.0 * line.per_slab * own;
      effect.drift_per_100_u = 100.0 * line.per_slab * u;
      effect.drifts = std::abs(own) >= limit_for(line.nu) * u;
      effect.now = line.now;
      effect.now_u = line.now_u;
      effect.slope = line.slope * line.per_slab;
      effect.slope_u = line.slope_u * line.per_slab;
    }
  }

  const Observations& observations_;
  std::size_t rows_;
  std::size_t places_;
  Cells cells_;
  TwoWay two_way_;
  Model model_;
};

}  // namespace

std::string_view name(Signal signal) {
  switch (signal) {
    case Signal::grey: break;
    case Signal::none: return "none";
    case Signal::mould: return "mould";
    case Signal::line: return "line";
  }
  return "grey";
}

Model fit(const Observations& observations) {
  return Estimate(observations).fit();
}

SlabsLeft slabs_left(const MouldEffect& effect, double lower, double upper) {
  if (!effect.drifts || effect.slope == 0.0) return {};
  if (effect.now > upper || effect.now < lower) return {0.0, 0.0};
  const double limit = effect.slope > 0.0 ? upper : lower;
  if (!has_value(limit)) return {};
  SlabsLeft left;
  left.slabs = (limit - effect.now) / effect.slope;
  left.u = std::sqrt(square(effect.now_u) + square(left.slabs * effect.slope_u)) / std::abs(effect.slope);
  return left;
}

}  // namespace slabd::cli::mould
