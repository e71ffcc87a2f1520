// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

#include "base/items.h"

/// Statistics of the mould ledger: effects of the moulds and of the inspection line on one item.
///
/// Problem: a slab is not ground after casting, so the deviation of a seat is that of its mould, plus that of the line
/// which inspects it. Every mould passes the same stations. Idea: a two-way model
///
///     value = level + mould + station + mould x station + rest
///
/// An effect of a station that all moulds share is the inspection line's. One that goes with a mould is the mould's.
/// The model is robust: medians give the start, Huber's weights the result. It accepts unbalanced data.
namespace slabd::cli::mould {

/// Minimum number of slabs for a judgement; with fewer an effect is shown grey.
inline constexpr std::size_t kSlabsMin = 5;
/// Minimum number of moulds at a place. The centre of two is as far from one as from the other.
inline constexpr std::size_t kMouldsMin = 3;
/// Minimum number of places for effects of the line. With fewer they cannot be told from the level.
inline constexpr std::size_t kPlacesMin = 3;
/// Minimum number of slabs for a drift.
inline constexpr std::size_t kDriftSlabsMin = 20;
/// Signal limit in standard errors.
inline constexpr double kSignal = 4.0;
/// Largest probability of a signal without an effect. It raises the limit where the standard error itself is uncertain.
inline constexpr double kFalseSignals = 2e-4;
/// Weight of the newest value in the moving average.
inline constexpr double kNewest = 0.2;

enum class Signal : std::uint8_t {
  grey,   ///< fewer than kSlabsMin slabs
  none,   ///< no effect was proven, or there are too few moulds to compare
  mould,  ///< the deviation goes with the mould
  line,   ///< all moulds have it at this station
};
/// "grey", "none", "mould", "line".
[[nodiscard]] std::string_view name(Signal signal);

/// One value of an item.
struct Observation {
  std::uint32_t row = 0;    ///< mould in one epoch
  std::uint32_t place = 0;  ///< station, pair of stations, or the slab
  double value = kNoValue;  ///< measured minus nominal
  double day = 0.0;         ///< time of casting, in days since any origin
};

/// Values of one item of one slab type, in the order of casting.
struct Observations {
  std::vector<std::uint32_t> mould;  ///< number of the mould of each row; a mould has a row for each epoch
  std::size_t places = 0;
  std::vector<Observation> values;  ///< values that are not finite are ignored
};

struct Effect {
  std::size_t n = 0;       ///< slabs
  double bias = kNoValue;  ///< NaN if it cannot be estimated
  double u = kNoValue;     ///< standard error
  double U = kNoValue;     ///< half of the 95 % interval, by Student's t
  Signal signal = Signal::grey;
};

/// Effect of one mould at one place.
struct MouldEffect : Effect {
  double ewma = kNoValue;  ///< exponentially weighted moving average of the effect: its value now
  double ewma_u = kNoValue;
  /// Change of the effect per 100 slabs of this mould, relative to the other moulds. NaN below kDriftSlabsMin slabs, or
  /// with too few moulds.
  double drift_per_100 = kNoValue;
  double drift_per_100_u = kNoValue;
  bool drifts = false;        ///< the drift is a signal
  double now = kNoValue;      ///< value minus nominal at the newest slab, by the straight line of the drift
  double slope = kNoValue;    ///< change of the value per slab, effects of the line included
  double slope_u = kNoValue;  ///< standard error of `slope`
  double now_u = kNoValue;    ///< standard error of `now`
};

struct Model {
  double level = kNoValue;          ///< value minus nominal of a typical mould at a typical place
  double scatter = kNoValue;        ///< standard deviation of a mould's values at one place, of a typical mould
  std::size_t places = 0;           ///< of `mould`
  std::vector<std::size_t> moulds;  ///< [place]: different moulds with at least kSlabsMin slabs
  std::vector<Effect> line;         ///< [place]; empty below kPlacesMin places
  std::vector<MouldEffect> mould;   ///< [row * places + place]

  [[nodiscard]] const MouldEffect& at(std::size_t row, std::size_t place) const { return mould[row * places + place]; }
  /// True if moulds and line can be told apart at this place.
  [[nodiscard]] bool separates(std::size_t place) const { return moulds[place] >= kMouldsMin; }
};

/// Effects of one item. Cost is proportional to the number of values.
///
/// Value of a mould at a place: Huber's estimate (k = 1.5). Its variance is the scatter of its own values, moderated by
/// that of all other moulds and places (Smyth 2004), so that five slabs do not claim a small error by chance.
/// Centre of a place: Huber's estimate over the moulds, weighted with the variances and the scatter between moulds.
/// Moulds further away than four standard deviations do not take part. A mould is compared with the centre of the
/// others, without itself.
[[nodiscard]] Model fit(const Observations& observations);

/// Number of further slabs until the value leaves `lower` .. `upper` (deviations from the nominal; NaN: no limit) at
/// the present rate. NaN if the effect does not drift, or not towards a limit. 0 if the value is outside already.
struct SlabsLeft {
  double slabs = kNoValue;
  double u = kNoValue;  ///< standard error
};
[[nodiscard]] SlabsLeft slabs_left(const MouldEffect& effect, double lower, double upper);

}  // namespace slabd::cli::mould
