// SPDX-License-Identifier: Apache-2.0
//
// The two-way model of moulds and stations against values with known effects. The values are drawn here, with the
// generator of the standard library, and share no code with the emulator.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <vector>

#include "cli/mould/model.h"

namespace slabd::cli::mould {
namespace {

constexpr std::size_t kPlaces = 18;

/// A line with known effects.
struct Plant {
  explicit Plant(std::size_t moulds, std::uint64_t seed)
      : random(seed), mould(moulds, std::vector<double>(kPlaces, 0.0)), line(kPlaces, 0.0), scatter(moulds, 0.1) {}

  double normal() { return std::normal_distribution<double>()(random); }
  double between(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); }
  double signed_size(double low, double high) {
    return between(-1.0, 1.0) < 0.0 ? -between(low, high) : between(low, high);
  }
  bool happens(double share) { return between(0.0, 1.0) < share; }

  /// Plants biases of 0.05 to 0.3 mm at a share of the seats, and at `stations` stations of the line.
  void plant(double share, int stations) {
    for (std::vector<double>& seats : mould)
      for (double& seat : seats)
        if (happens(share)) seat = signed_size(0.05, 0.3);
    for (int i = 0; i < stations; ++i) line[random() % kPlaces] = signed_size(0.05, 0.3);
  }

  /// One more slab of a mould.
  void cast(std::uint32_t which) {
    for (std::uint32_t place = 0; place < kPlaces; ++place) {
      double value = level + line[place] + mould[which][place] + scatter[which] * normal();
      if (happens(missing)) value = kNoValue;
      if (happens(outliers)) value += signed_size(0.8, 3.0);
      data.values.push_back({which, place, value, day});
    }
    day += 0.025;
  }

  Model fitted() {
    data.places = kPlaces;
    data.mould.clear();
    for (std::size_t i = 0; i < mould.size(); ++i) data.mould.push_back(static_cast<std::uint32_t>(i + 1));
    return fit(data);
  }

  std::mt19937_64 random;
  std::vector<std::vector<double>> mould;  ///< [mould][place]
  std::vector<double> line;
  std::vector<double> scatter;  ///< [mould]
  double level = 0.07;
  double missing = 0.0;
  double outliers = 0.0;
  double day = 0.0;
  Observations data;
};

struct Score {
  std::size_t effects = 0;
  std::size_t within = 0;
  std::size_t planted = 0;
  std::size_t confused = 0;
  std::size_t large = 0;  ///< planted effects of 0.1 mm and more
  std::size_t found = 0;  ///< ... with the right signal
  std::size_t idle = 0;   ///< effects where nothing is planted
  std::size_t false_signals = 0;

  [[nodiscard]] double coverage() const { return static_cast<double>(within) / static_cast<double>(effects); }

  void judge(const Effect& effect, double truth, bool is_line) {
    if (effect.n == 0) return;
    ++effects;
    if (std::abs(effect.bias - truth) <= effect.U) ++within;
    const bool signal = effect.signal == (is_line ? Signal::line : Signal::mould);
    if (truth == 0.0) {
      ++idle;
      false_signals += signal ? 1 : 0;
      return;
    }
    ++planted;
    if (std::abs(truth) < 0.1) return;
    ++large;
    found += signal ? 1 : 0;
  }
};

/// Moulds and line in two scores, with what was confused in that of its cause.
void judge(const Plant& plant, const Model& model, Score& moulds, Score& line) {
  for (std::size_t place = 0; place < kPlaces; ++place) {
    line.judge(model.line[place], plant.line[place], true);
    bool planted_mould = false;
    for (std::size_t i = 0; i < plant.mould.size(); ++i) {
      moulds.judge(model.at(i, place), plant.mould[i][place], false);
      planted_mould = planted_mould || plant.mould[i][place] != 0.0;
      if (plant.line[place] != 0.0 && plant.mould[i][place] == 0.0 && model.at(i, place).signal == Signal::mould)
        ++line.confused;
    }
    if (planted_mould && plant.line[place] == 0.0 && model.line[place].signal == Signal::line) ++moulds.confused;
  }
}

TEST(MouldModel, moulds_and_line_are_separated_with_true_errors_in_3000_slabs_of_40_moulds) {
  Score moulds;
  Score line;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    Plant plant(40, seed);
    plant.missing = 0.01;
    plant.outliers = 0.005;
    plant.plant(0.2, 4);
    for (int slab = 0; slab < 3000; ++slab) plant.cast(static_cast<std::uint32_t>(plant.random() % 40));
    judge(plant, plant.fitted(), moulds, line);
  }
  RecordProperty("mould_coverage", std::to_string(moulds.coverage()));
  RecordProperty("line_coverage", std::to_string(line.coverage()));
  EXPECT_GT(moulds.effects, 43'000U);
  EXPECT_GE(moulds.coverage(), 0.935);
  EXPECT_LE(moulds.coverage(), 0.97);
  EXPECT_EQ(line.effects, 1'080U);
  EXPECT_GE(line.coverage(), 0.935 - 0.01) << "1,080 effects: one standard error is 0.7 %";
  EXPECT_LE(line.coverage(), 0.97 + 0.01);
  const auto planted = static_cast<double>(moulds.planted + line.planted);
  EXPECT_LT(static_cast<double>(moulds.confused + line.confused), 0.01 * planted)
      << moulds.confused << " of moulds, " << line.confused << " of the line";
  EXPECT_GE(static_cast<double>(moulds.found), 0.99 * static_cast<double>(moulds.large));
  EXPECT_GE(static_cast<double>(line.found), 0.99 * static_cast<double>(line.large));
  EXPECT_LT(static_cast<double>(moulds.false_signals), 1e-3 * static_cast<double>(moulds.idle));
}

TEST(MouldModel, errors_are_true_with_few_slabs_of_moulds_that_scatter_differently) {
  Score moulds;
  Score line;
  for (std::uint64_t seed = 100; seed < 125; ++seed) {
    Plant plant(12, seed);
    plant.plant(0.1, 2);
    for (double& scatter : plant.scatter) scatter = plant.between(0.05, 0.25);
    for (std::uint32_t mould = 0; mould < 12; ++mould)
      for (std::uint64_t slab = 0, slabs = 5 + plant.random() % 10; slab < slabs; ++slab) plant.cast(mould);
    judge(plant, plant.fitted(), moulds, line);
  }
  EXPECT_GE(moulds.coverage(), 0.935);
  EXPECT_LE(moulds.coverage(), 0.97);
  EXPECT_GE(line.coverage(), 0.915);
  EXPECT_LE(static_cast<double>(moulds.false_signals), 1e-3 * static_cast<double>(moulds.idle));
}

TEST(MouldModel, a_bias_of_the_size_of_the_scatter_is_signalled_after_at_most_20_castings) {
  std::vector<int> needed;
  for (std::uint64_t seed = 200; seed < 204; ++seed) {
    Plant plant(20, seed);
    std::map<std::pair<std::size_t, std::size_t>, int> first;
    for (std::size_t i = 0; i < 20; ++i) {
      const std::size_t place = (7 * i) % kPlaces;
      plant.mould[i][place] = i % 2 == 0 ? 0.1 : -0.1;
      first[{i, place}] = 100;
    }
    for (int castings = 1; castings <= 40; ++castings) {
      for (std::uint32_t mould = 0; mould < 20; ++mould) plant.cast(mould);
      if (castings < 5) continue;
      const Model model = plant.fitted();
      for (auto& [at, when] : first)
        if (when == 100 && model.at(at.first, at.second).signal == Signal::mould) when = castings;
    }
    for (const auto& [at, when] : first) needed.push_back(when);
  }
  std::nth_element(needed.begin(), needed.begin() + 40, needed.end());
  RecordProperty("castings", needed[40]);
  EXPECT_LE(needed[40], 20);
}

TEST(MouldModel, signals_without_an_effect_are_rarer_than_one_in_a_thousand) {
  std::size_t effects = 0;
  std::size_t signals = 0;
  for (std::uint64_t seed = 300; seed < 320; ++seed) {
    Plant plant(30, seed);
    const int castings = 5 + static_cast<int>(seed % 4) * 5;
    for (int i = 0; i < castings; ++i)
      for (std::uint32_t mould = 0; mould < 30; ++mould) plant.cast(mould);
    const Model model = plant.fitted();
    for (const Effect& effect : model.mould) {
      ++effects;
      signals += effect.signal == Signal::mould ? 1 : 0;
    }
    for (const Effect& effect : model.line) {
      ++effects;
      signals += effect.signal == Signal::line ? 1 : 0;
    }
  }
  EXPECT_GT(effects, 11'000U);
  EXPECT_LT(static_cast<double>(signals), 1e-3 * static_cast<double>(effects));
}

TEST(MouldModel, one_or_two_moulds_are_never_told_from_the_line) {
  for (const std::size_t moulds : {std::size_t{1}, std::size_t{2}}) {
    Plant plant(moulds, 7);
    plant.line[4] = 0.5;
    plant.mould[0][9] = 0.5;
    for (int i = 0; i < 50; ++i)
      for (std::uint32_t mould = 0; mould < moulds; ++mould) plant.cast(mould);
    const Model model = plant.fitted();
    for (std::size_t place = 0; place < kPlaces; ++place) {
      EXPECT_FALSE(model.separates(place));
      EXPECT_EQ(model.line[place].signal, Signal::none);
      for (std::size_t i = 0; i < moulds; ++i) EXPECT_EQ(model.at(i, place).signal, Signal::none);
    }
  }
}

TEST(MouldModel, two_epochs_of_one_mould_are_one_mould) {
  Plant plant(3, 8);
  plant.mould[0][9] = 0.5;
  for (int i = 0; i < 50; ++i)
    for (std::uint32_t row = 0; row < 3; ++row) plant.cast(row);
  plant.data.places = kPlaces;
  plant.data.mould = {5, 5, 6};
  const Model model = fit(plant.data);
  EXPECT_FALSE(model.separates(9));
  EXPECT_EQ(model.at(0, 9).signal, Signal::none);
}

TEST(MouldModel, an_epoch_has_its_own_effects) {
  Plant plant(6, 9);
  plant.mould[0][9] = 0.3;  // corrected in row 5, the same mould
  for (int i = 0; i < 40; ++i)
    for (std::uint32_t row = 0; row < 6; ++row) plant.cast(row);
  plant.data.places = kPlaces;
  plant.data.mould = {1, 2, 3, 4, 5, 1};
  const Model model = fit(plant.data);
  EXPECT_EQ(model.at(0, 9).signal, Signal::mould);
  EXPECT_NEAR(model.at(0, 9).bias, 0.3, 0.08);
  EXPECT_EQ(model.at(5, 9).signal, Signal::none);
}

TEST(MouldModel, fewer_than_five_slabs_are_grey_and_a_mould_may_have_made_only_some) {
  Plant plant(5, 10);
  plant.mould[4][3] = 3.0;
  for (int i = 0; i < 30; ++i)
    for (std::uint32_t mould = 0; mould < 4; ++mould) plant.cast(mould);
  for (int i = 0; i < 4; ++i) plant.cast(4);
  Model model = plant.fitted();
  EXPECT_EQ(model.at(4, 3).signal, Signal::grey);
  EXPECT_NEAR(model.at(4, 3).bias, 3.0, 0.2) << "shown, not judged";
  plant.cast(4);
  model = plant.fitted();
  EXPECT_EQ(model.at(4, 3).signal, Signal::mould);
  EXPECT_EQ(model.moulds[3], 5U);
  // A mould whose slabs have no value at a place.
  for (Observation& o : plant.data.values)
    if (o.row == 0 && o.place == 3) o.value = kNoValue;
  model = plant.fitted();
  EXPECT_EQ(model.at(0, 3).n, 0U);
  EXPECT_EQ(model.at(0, 3).signal, Signal::grey);
  EXPECT_FALSE(has_value(model.at(0, 3).bias));
  EXPECT_EQ(model.moulds[3], 4U);
}

TEST(MouldModel, items_with_one_place_have_moulds_and_no_line) {
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal(0.0, 0.1);
  Observations data;
  data.mould = {1, 2, 3, 4, 5};
  data.places = 1;
  for (int i = 0; i < 30; ++i)
    for (std::uint32_t row = 0; row < 5; ++row)
      data.values.push_back({row, 0, (row == 2 ? 0.4 : 0.0) + normal(random), 1.0 * i});
  const Model model = fit(data);
  EXPECT_TRUE(model.line.empty());
  EXPECT_EQ(model.at(2, 0).signal, Signal::mould);
  EXPECT_NEAR(model.at(2, 0).bias, 0.4, 3.0 * model.at(2, 0).u);
  for (const std::size_t row : {0U, 1U, 3U, 4U}) EXPECT_EQ(model.at(row, 0).signal, Signal::none);
}

TEST(MouldModel, no_values_and_equal_values_have_no_signal) {
  Observations data;
  data.mould = {1, 2, 3};
  data.places = 4;
  Model model = fit(data);
  for (const MouldEffect& effect : model.mould) EXPECT_EQ(effect.signal, Signal::grey);
  for (int i = 0; i < 30; ++i)
    for (std::uint32_t row = 0; row < 3; ++row)
      for (std::uint32_t place = 0; place < 4; ++place) data.values.push_back({row, place, 0.25, 1.0 * i});
  model = fit(data);
  EXPECT_NEAR(model.level, 0.25, 1e-9);
  for (const MouldEffect& effect : model.mould) {
    EXPECT_EQ(effect.signal, Signal::none);
    EXPECT_FALSE(effect.drifts);
    EXPECT_TRUE(std::isfinite(effect.U));
  }
}

TEST(MouldModel, wear_of_one_mould_is_a_drift_with_the_slabs_until_its_limit) {
  int within = 0;
  for (int repeat = 0; repeat < 40; ++repeat) {
    Plant worn(8, 1000U + static_cast<std::uint64_t>(repeat));
    for (int i = 0; i < 80; ++i)
      for (std::uint32_t mould = 0; mould < 8; ++mould) {
        worn.mould[3][6] = 0.004 * i;
        worn.cast(mould);
      }
    const Model model = worn.fitted();
    ASSERT_TRUE(model.at(3, 6).drifts);
    EXPECT_NEAR(model.at(3, 6).drift_per_100, 0.4, 5.0 * model.at(3, 6).drift_per_100_u);
    // Now 0.07 + 0.316, the upper limit is reached at 0.5.
    const SlabsLeft left = slabs_left(model.at(3, 6), -0.5, 0.5);
    within += std::abs(left.slabs - 28.5) <= 2.0 * left.u ? 1 : 0;
    EXPECT_NEAR(model.at(3, 6).ewma, 0.316 - 0.016, 5.0 * model.at(3, 6).ewma_u);
    EXPECT_FALSE(has_value(slabs_left(model.at(3, 6), -0.5, kNoValue).slabs)) << "no limit on that side";
    EXPECT_EQ(slabs_left(model.at(3, 6), -0.5, 0.2).slabs, 0.0) << "outside already";
    EXPECT_FALSE(has_value(slabs_left(model.at(2, 6), -0.5, 0.5).slabs)) << "this one does not drift";
  }
  EXPECT_GE(within, 34);
}

TEST(MouldModel, a_drift_of_all_moulds_is_not_a_mould_that_wears) {
  Plant plant(8, 13);
  for (int i = 0; i < 80; ++i)
    for (std::uint32_t mould = 0; mould < 8; ++mould) {
      plant.line[6] = 0.01 * i;
      plant.cast(mould);
    }
  const Model model = plant.fitted();
  for (const MouldEffect& effect : model.mould) EXPECT_FALSE(effect.drifts);
}

}  // namespace
}  // namespace slabd::cli::mould
