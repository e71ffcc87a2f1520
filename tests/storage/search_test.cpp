// SPDX-License-Identifier: Apache-2.0
//
// Searches for slabs and values among many, compared with known answers.
#include <algorithm>
#include <cmath>

#include "storage/history_writer.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

class SearchTest : public StoreTest {
 protected:
  static Item an_item(ItemId id, int station, double value, Verdict verdict) {
    Item item;
    item.id = id;
    item.station = static_cast<std::uint8_t>(station);
    item.value = value;
    item.upper = 1.0;
    item.verdict = verdict;
    return item;
  }
  /// Adds an attempt whose only items are flatness and slope.
  void measured(std::int64_t key, int station, int number, double flatness_mm, Verdict verdict) {
    acquire(key, station, number);
    BlockResult block;
    block.station = static_cast<std::uint8_t>(station);
    block.verdict = verdict;
    EXPECT_TRUE(block.items.push(an_item(ItemId::seat_flatness, station, flatness_mm, verdict)));
    EXPECT_TRUE(block.items.push(an_item(ItemId::seat_slope, station, 1.0, Verdict::pass)));
    PlcResult record = random_record(prng_, ++res_seq_, 1);
    record.station = static_cast<std::uint16_t>(station);
    apply(BlockJob{key, static_cast<std::uint8_t>(number), block, record});
  }
  void ended(std::int64_t key, Verdict verdict, int bad_station) {
    SlabResult slab;
    slab.verdict = verdict;
    slab.station_verdict.fill(Verdict::pass);
    if (bad_station > 0) slab.station_verdict[static_cast<std::size_t>(bad_station - 1)] = verdict;
    // SLAB_END recomputes the slope of station 2.
    EXPECT_TRUE(slab.items.push(an_item(ItemId::seat_slope, 2, 1.25, verdict)));
    EXPECT_TRUE(slab.items.push(an_item(ItemId::corner_level, 0, 0.5, Verdict::pass)));
    apply(SlabJob{key, slab, random_record(prng_, ++res_seq_, 2), 9'000'000});
  }
  /// Creates four slabs: slab n begins at n seconds and has type 56 (odd) or 49. Slab 1 passes, 2 fails at block 2's
  /// flatness. Slab 3 fails at block 7 in an attempt that was scanned again and passes; slab 4 is open. The moulds are
  /// 7, 8, 8 and unknown.
  void make_four() {
    open();
    for (std::int64_t key = 1; key <= 4; ++key) {
      BeginSlabJob job{random_header(prng_, key), 1, ++cmd_seq_};
      job.slab.slab_type = key % 2 == 1 ? 56 : 49;
      job.slab.slab_id.assign("LINE-A-" + std::to_string(key));
      job.slab.began_utime_us = key * 1'000'000;
      job.slab.stations = key == 1 ? 16 : 18;
      job.slab.mould = static_cast<std::uint16_t>(key == 4 ? 0 : 7 + key / 2);
      apply(job);
      measured(key, 2, 1, 0.1 * static_cast<double>(key), key == 2 ? Verdict::fail : Verdict::pass);
      if (key == 3) {
        measured(key, 7, 1, 9.0, Verdict::fail);
        measured(key, 7, 2, 0.7, Verdict::pass);
      }
      if (key < 4) ended(key, key == 2 ? Verdict::fail : Verdict::pass, key == 2 ? 2 : 0);
    }
  }
  std::vector<std::int64_t> found(const SlabFilter& filter) {
    const Result<std::vector<SlabSummary>> slabs = reader()->slabs(filter);
    EXPECT_TRUE(slabs.ok()) << slabs.error().text.view();
    std::vector<std::int64_t> keys;
    if (slabs.ok())
      for (const SlabSummary& slab : slabs.value()) keys.push_back(slab.header.key);
    return keys;
  }
};

using Keys = std::vector<std::int64_t>;

TEST_F(SearchTest, slabs_by_time_type_id_and_verdict) {
  make_four();
  SlabFilter filter;
  EXPECT_EQ(found(filter), (Keys{4, 3, 2, 1}));
  filter.limit = 2;
  EXPECT_EQ(found(filter), (Keys{4, 3}));
  filter = {};
  filter.since_utime_us = 2'000'000;
  filter.until_utime_us = 4'000'000;
  EXPECT_EQ(found(filter), (Keys{3, 2}));
  filter = {};
  filter.slab_type = 56;
  EXPECT_EQ(found(filter), (Keys{3, 1}));
  filter = {};
  filter.verdict = Verdict::fail;
  EXPECT_EQ(found(filter), (Keys{2}));
  filter.slab_type = 56;
  EXPECT_EQ(found(filter), Keys{}) << "all conditions must hold";
  filter = {};
  filter.id_part = "A-3";
  EXPECT_EQ(found(filter), (Keys{3}));
  filter.id_part = "%";
  EXPECT_EQ(found(filter), Keys{}) << "an id is text, not a pattern";
}

TEST_F(SearchTest, slabs_and_values_by_mould) {
  make_four();
  SlabFilter slabs;
  slabs.mould = 8;
  EXPECT_EQ(found(slabs), (Keys{3, 2}));
  slabs.verdict = Verdict::pass;
  EXPECT_EQ(found(slabs), Keys{3}) << "all conditions must hold";
  slabs = {};
  slabs.mould = 9;
  EXPECT_EQ(found(slabs), Keys{});
  ItemFilter values;
  values.item = ItemId::seat_flatness;
  values.block = 2;
  values.mould = 7;
  ASSERT_EQ(reader()->values(values).value().size(), 1U);
  EXPECT_EQ(reader()->values(values).value()[0].slab_key, 1);
  values.mould = 8;
  EXPECT_EQ(reader()->values(values).value().size(), 2U);
  values.slabs = 1;
  EXPECT_EQ(reader()->values(values).value().size(), 1U) << "the newest of the mould";
}

TEST_F(SearchTest, slabs_by_block_and_item) {
  make_four();
  SlabFilter filter;
  filter.block = 2;
  EXPECT_EQ(found(filter), (Keys{2})) << "any verdict but pass";
  filter.verdict = Verdict::pass;
  EXPECT_EQ(found(filter), (Keys{3, 1})) << "an open slab has no final verdicts";
  filter = {};
  filter.item = ItemId::seat_flatness;
  filter.verdict = Verdict::fail;
  EXPECT_EQ(found(filter), (Keys{2})) << "an attempt that was scanned again does not count";
  filter.block = 2;
  filter.verdict = Verdict::none;
  EXPECT_EQ(found(filter), (Keys{2}));
  filter.verdict = Verdict::pass;
  EXPECT_EQ(found(filter), (Keys{4, 3, 1}));
  filter.item = ItemId::seat_slope;
  filter.verdict = Verdict::fail;
  EXPECT_EQ(found(filter), (Keys{2})) << "the slab's own slope of block 2";
}

TEST_F(SearchTest, an_inspection_is_repeated_if_its_id_was_inspected_before_and_not_aborted) {
  open();
  const std::array<std::pair<const char*, Verdict>, 7> slabs = {{{"A", Verdict::aborted},
                                                                 {"A", Verdict::fail},
                                                                 {"B", Verdict::pass},
                                                                 {"A", Verdict::pass},
                                                                 {"", Verdict::pass},
                                                                 {"", Verdict::indeterminate},
                                                                 {"E", Verdict::pass}}};
  for (std::size_t i = 0; i < slabs.size(); ++i) {
    const auto key = static_cast<std::int64_t>(i + 1);
    BeginSlabJob job{random_header(prng_, key), 1, ++cmd_seq_};
    job.slab.slab_id.assign(slabs[i].first);
    job.slab.began_utime_us = key * 1'000'000;
    job.slab.slab_type = 56;
    job.slab.mould = static_cast<std::uint16_t>(key);
    job.slab.emulated = i == 2 ? 1 : 0;
    apply(job);
    if (i + 1 < slabs.size()) ended(key, slabs[i].second, 0);
  }
  InspectionFilter filter;
  Inspections found = reader()->inspections(filter).value();
  ASSERT_EQ(found.list.size(), 5U) << "without the open slab and the emulated one";
  EXPECT_EQ(found.others, 1U);
  EXPECT_EQ(found.emulated, 0);
  const std::array<std::int64_t, 5> keys = {1, 2, 4, 5, 6};
  for (std::size_t i = 0; i < keys.size(); ++i) {
    EXPECT_EQ(found.list[i].slab_key, keys.at(i));
    EXPECT_EQ(found.list[i].mould, keys.at(i));
    EXPECT_EQ(found.list[i].again, keys.at(i) == 4) << keys.at(i);
    EXPECT_EQ(found.list[i].verdict, slabs.at(static_cast<std::size_t>(keys.at(i) - 1)).second);
  }
  filter.since_utime_us = 4'000'000;
  filter.until_utime_us = 6'000'000;
  found = reader()->inspections(filter).value();
  ASSERT_EQ(found.list.size(), 2U);
  EXPECT_TRUE(found.list[0].again) << "the first inspection was before the interval";
  filter.slab_type = 49;
  EXPECT_TRUE(reader()->inspections(filter).value().list.empty());
}

// If no scan has a result, the item rows are missing, and nothing was measured.
TEST_F(SearchTest, an_item_is_not_measured_where_its_station_has_no_result) {
  make_four();
  ended(4, Verdict::not_measured, 0);
  BeginSlabJob job{random_header(prng_, 5), 1, ++cmd_seq_};
  job.slab.slab_type = 56;
  apply(job);
  measured(5, 2, 1, 0.5, Verdict::pass);
  apply(FailedAttemptJob{attempt(5, 2, 2), 402});
  SlabFilter filter;
  filter.item = ItemId::seat_flatness;
  filter.block = 2;
  EXPECT_EQ(found(filter), Keys{2}) << "5 is still open";
  ended(5, Verdict::not_measured, 2);
  EXPECT_EQ(found(filter), (Keys{5, 2})) << "its newest attempt failed";
  filter.verdict = Verdict::not_measured;
  EXPECT_EQ(found(filter), Keys{5});
  filter.verdict = Verdict::fail;
  EXPECT_EQ(found(filter), Keys{2});
  filter.verdict = Verdict::none;
  filter.block = 7;
  EXPECT_EQ(found(filter), (Keys{5, 4, 2})) << "never scanned there; 1 has passed, so that it was seen everywhere";
  filter.block = 0;
  EXPECT_EQ(found(filter), (Keys{5, 4, 3, 2})) << "at any block; an attempt of 3 failed";
  filter.item = ItemId::corner_level;
  EXPECT_EQ(found(filter), Keys{}) << "the slab's own items have their rows";
  filter.item = ItemId::seat_flatness;
  filter.block = 18;
  EXPECT_EQ(found(filter), (Keys{5, 4, 3, 2}));
  filter.item.reset();
  filter.verdict = Verdict::pass;
  EXPECT_EQ(found(filter), (Keys{5, 4, 3, 2}));
  ItemFilter values;
  values.item = ItemId::seat_flatness;
  values.slab_type = 56;
  const auto found_values = reader()->values(values);
  ASSERT_TRUE(found_values.ok()) << found_values.error().text.view();
  ASSERT_EQ(found_values.value().size(), 16U + 18U + 18U) << "one of each block";
  for (const ItemValue& value : found_values.value()) {
    EXPECT_EQ(value.slab_type, 56);
    const int station = value.item.station;
    const bool is_measured =
        (value.slab_key == 1 && station == 2) || (value.slab_key == 3 && (station == 2 || station == 7));
    EXPECT_EQ(has_value(value.item.value), is_measured) << value.slab_key << " " << station;
    EXPECT_EQ(value.item.verdict, is_measured ? Verdict::pass : Verdict::not_measured);
  }
  values.block = 7;
  EXPECT_EQ(reader()->values(values).value().size(), 3U);
}

// A block's pass is provisional until the slab is judged.
TEST_F(SearchTest, no_block_of_an_aborted_slab_passed_whatever_a_version_before_wrote) {
  make_four();
  ended(4, Verdict::aborted, 0);
  SlabFilter filter;
  filter.block = 2;
  filter.verdict = Verdict::pass;
  EXPECT_EQ(found(filter), (Keys{3, 1}));
  filter.verdict = Verdict::none;
  EXPECT_EQ(found(filter), (Keys{4, 2}));
  const auto record = reader()->slab(4);
  ASSERT_TRUE(record.ok() && record.value());
  for (const Verdict verdict : record.value()->slab.station_verdict) EXPECT_EQ(verdict, Verdict::none);
  for (const SlabBlock& block : record.value()->blocks) EXPECT_EQ(block.final_verdict, Verdict::none);
}

TEST_F(SearchTest, a_block_without_a_result_is_not_counted_as_measured) {
  make_four();
  measured(4, 9, 1, 1.0, Verdict::not_measured);
  const auto slabs = reader()->slabs(SlabFilter());
  ASSERT_TRUE(slabs.ok());
  ASSERT_EQ(slabs.value().size(), 4U);
  EXPECT_EQ(slabs.value()[0].stations_measured, 1);
  const auto slab = reader()->slab(4);
  ASSERT_TRUE(slab.ok() && slab.value());
  EXPECT_EQ(slab.value()->summary.stations_measured, 1) << "the same of both";
}

TEST_F(SearchTest, an_item_for_information_does_not_take_the_place_of_the_one_that_was_judged) {
  open();
  apply(BeginSlabJob{random_header(prng_, 1), 1, ++cmd_seq_});
  acquire(1, 2, 1);
  BlockResult block;
  block.station = 2;
  block.verdict = Verdict::fail;
  ASSERT_TRUE(block.items.push(an_item(ItemId::seat_slope, 2, 1.59, Verdict::fail)));
  PlcResult record = random_record(prng_, ++res_seq_, 1);
  record.station = 2;
  apply(BlockJob{1, 1, block, record});
  SlabResult slab;
  slab.verdict = Verdict::fail;
  Item in_slab = an_item(ItemId::seat_slope, 2, 1.42, Verdict::none);
  in_slab.lower = in_slab.upper = kNoValue;
  ASSERT_TRUE(slab.items.push(in_slab));
  apply(SlabJob{1, slab, random_record(prng_, ++res_seq_, 2), 9'000'000});
  ItemFilter values;
  values.item = ItemId::seat_slope;
  values.block = 2;
  const auto found_values = reader()->values(values);
  ASSERT_TRUE(found_values.ok()) << found_values.error().text.view();
  ASSERT_EQ(found_values.value().size(), 1U);
  EXPECT_EQ(found_values.value()[0].item.value, 1.59);
  EXPECT_EQ(found_values.value()[0].item.verdict, Verdict::fail);
  SlabFilter failed;
  failed.item = ItemId::seat_slope;
  failed.verdict = Verdict::fail;
  EXPECT_EQ(found(failed), Keys{1});
}

TEST_F(SearchTest, an_item_for_information_that_was_not_measured_is_not_found) {
  // slope_datum = "local_slab_top" without a slab frame: the block's slope was judged and passed.
  open();
  apply(BeginSlabJob{random_header(prng_, 1), 1, ++cmd_seq_});
  for (int station = 1; station <= 18; ++station) measured(1, station, 1, 0.1, Verdict::pass);
  SlabResult slab;
  slab.verdict = Verdict::not_measured;
  Item in_slab = an_item(ItemId::seat_slope, 2, kNoValue, Verdict::not_measured);
  in_slab.lower = in_slab.upper = kNoValue;
  ASSERT_TRUE(slab.items.push(in_slab));
  ASSERT_TRUE(slab.items.push(an_item(ItemId::seat_lateral, 2, kNoValue, Verdict::not_measured)));
  apply(SlabJob{1, slab, random_record(prng_, ++res_seq_, 2), 9'000'000});
  SlabFilter filter;
  for (const Verdict verdict : {Verdict::none, Verdict::not_measured}) {
    filter.verdict = verdict;
    filter.item = ItemId::seat_slope;
    EXPECT_EQ(found(filter), Keys{}) << name(verdict);
    filter.item = ItemId::seat_lateral;
    EXPECT_EQ(found(filter), Keys{1}) << name(verdict);
  }
  filter.verdict = Verdict::pass;
  filter.item = ItemId::seat_slope;
  EXPECT_EQ(found(filter), Keys{1});
}

TEST_F(SearchTest, values_are_those_of_valid_attempts_and_the_slabs_own_come_first) {
  make_four();
  ItemFilter filter;
  filter.item = ItemId::seat_flatness;
  Result<std::vector<ItemValue>> values = reader()->values(filter);
  ASSERT_TRUE(values.ok()) << values.error().text.view();
  std::erase_if(values.value(), [](const ItemValue& value) { return !has_value(value.item.value); });
  ASSERT_EQ(values.value().size(), 4U) << "without the open slab";
  EXPECT_EQ(values.value()[0].slab_key, 1);
  EXPECT_EQ(values.value()[0].slab_id.view(), "LINE-A-1");
  EXPECT_EQ(values.value()[0].began_utime_us, 1'000'000);
  EXPECT_EQ(values.value()[0].item.station, 2);
  EXPECT_EQ(values.value()[0].item.upper, 1.0);
  EXPECT_FALSE(has_value(values.value()[0].item.lower));
  EXPECT_EQ(values.value()[3].item.station, 7);
  EXPECT_EQ(values.value()[3].item.value, 0.7) << "not the attempt before";

  filter.item = ItemId::seat_slope;
  filter.block = 2;
  values = reader()->values(filter);
  ASSERT_TRUE(values.ok());
  ASSERT_EQ(values.value().size(), 3U);
  EXPECT_EQ(values.value()[0].item.value, 1.25) << "computed again by SLAB_END";
  filter.slabs = 1;
  EXPECT_EQ(reader()->values(filter).value().size(), 1U);
  filter = {};
  filter.item = ItemId::corner_level;
  filter.slab_type = 49;
  values = reader()->values(filter);
  ASSERT_EQ(values.value().size(), 1U);
  EXPECT_EQ(values.value()[0].slab_key, 2);
  EXPECT_EQ(values.value()[0].item.station, 0);
}

TEST_F(SearchTest, values_of_open_and_aborted_slabs_are_left_out) {
  make_four();
  ItemFilter filter;
  filter.item = ItemId::seat_flatness;
  filter.block = 2;
  const auto keys = [&] {
    const Result<std::vector<ItemValue>> values = reader()->values(filter);
    EXPECT_TRUE(values.ok()) << values.error().text.view();
    Keys list;
    for (const ItemValue& value : values.value()) list.push_back(value.slab_key);
    return list;
  };
  EXPECT_EQ(keys(), (Keys{1, 2, 3})) << "4 is open";
  ended(4, Verdict::aborted, 0);
  EXPECT_EQ(keys(), (Keys{1, 2, 3})) << "4 was aborted";
  filter.slabs = 2;
  EXPECT_EQ(keys(), (Keys{2, 3})) << "which takes no place among the newest either";
}

TEST_F(SearchTest, the_first_moment_of_1970_is_a_moment) {
  make_four();
  SlabFilter slabs;
  slabs.until_utime_us = 0;
  EXPECT_EQ(found(slabs), Keys{});
  slabs.until_utime_us = 1'000'001;
  EXPECT_EQ(found(slabs), Keys{1});
  ItemFilter values;
  values.item = ItemId::seat_flatness;
  values.until_utime_us = 0;
  EXPECT_EQ(reader()->values(values).value().size(), 0U);
}

TEST_F(SearchTest, values_of_the_moulds_are_those_of_the_items) {
  make_four();
  const MouldRecords records = reader()->mould_records({}).value();
  std::vector<std::int64_t> keys;
  for (const MouldSlab& slab : records.slabs) keys.push_back(slab.key);
  EXPECT_EQ(keys, (std::vector<std::int64_t>{1, 2, 3})) << "slab 4 is open";
  EXPECT_EQ(records.slabs[0].mould, 7);
  EXPECT_EQ(records.slabs[2].mould, 8);
  EXPECT_EQ(records.unknown, 1);
  std::size_t values = 0;
  for (std::size_t i = 0; i < kItemCount; ++i) {
    ItemFilter filter;
    filter.item = static_cast<ItemId>(i);
    const std::vector<ItemValue> list = reader()->values(filter).value();
    for (const ItemValue& expected : list) {
      if (!has_value(expected.item.value)) continue;
      ++values;
      const auto found = std::find_if(records.values.begin(), records.values.end(), [&](const MouldValue& value) {
        return records.slabs[value.slab].key == expected.slab_key && value.item == filter.item &&
               value.station == expected.item.station && value.station_to == expected.item.station_to;
      });
      ASSERT_NE(found, records.values.end()) << info(filter.item).name << " of slab " << expected.slab_key;
      EXPECT_FLOAT_EQ(found->deviation, static_cast<float>(expected.item.value));
      // Slabs 2 and 3 are the newest of their types; slab 4 is open.
      EXPECT_EQ(std::isnan(found->upper), expected.slab_key == 1);
      if (expected.slab_key != 1) {
        EXPECT_FLOAT_EQ(found->upper, 1.0F);
      }
      EXPECT_TRUE(std::isnan(found->lower));
    }
  }
  EXPECT_GT(values, 8U);
  EXPECT_EQ(records.values.size(), values) << "values that were replaced do not count";
  EXPECT_TRUE(std::is_sorted(records.values.begin(), records.values.end(),
                             [](const MouldValue& a, const MouldValue& b) { return a.slab < b.slab; }));
}

TEST_F(SearchTest, only_the_newest_castings_of_each_mould_are_read) {
  make_four();
  MouldFilter filter;
  filter.castings = 1;
  MouldRecords records = reader()->mould_records(filter).value();
  ASSERT_EQ(records.slabs.size(), 2U);
  EXPECT_EQ(records.slabs[0].key, 1);
  EXPECT_EQ(records.slabs[1].key, 3);
  filter = {};
  filter.slab_type = 49;
  records = reader()->mould_records(filter).value();
  ASSERT_EQ(records.slabs.size(), 1U);
  EXPECT_EQ(records.slabs[0].key, 2);
  filter = {};
  filter.since_utime_us = 2'000'000;
  filter.until_utime_us = 3'000'000;
  EXPECT_EQ(reader()->mould_records(filter).value().slabs.size(), 1U);
}

TEST_F(SearchTest, a_reset_of_a_mould_is_kept_and_a_wrong_one_is_refused) {
  make_four();
  const auto refused = [&](const ResetMould& reset, const char* words) {
    const Result<std::string> done = store_->change(reset);
    ASSERT_FALSE(done.ok());
    EXPECT_EQ(done.error().code, Code::config);
    EXPECT_NE(done.error().text.view().find(words), std::string_view::npos) << done.error().text.view();
  };
  const ChangeNote note{"anna", "shims set", 5'000'000};
  refused({0, 1'000'000, note}, "mould 0 is the unknown one");
  refused({9, 1'000'000, note}, "no stored slab is from mould 9");
  refused({8, 6'000'000, note}, "in the future");
  refused({8, 1'000'000, {"anna", "", 5'000'000}}, "give an operator and a reason");
  EXPECT_EQ(store_->change(ResetMould{8, 2'500'000, note}).value(), "mould-8-epoch-2");
  EXPECT_EQ(store_->change(ResetMould{8, 2'500'000, note}).value(), "mould-8-epoch-2") << "its answer was lost";
  refused({8, 2'000'000, note}, "it was reset after that time");
  EXPECT_EQ(store_->change(ResetMould{8, 4'500'000, note}).value(), "mould-8-epoch-3");
  const MouldRecords records = reader()->mould_records({}).value();
  ASSERT_EQ(records.resets.size(), 2U);
  EXPECT_EQ(records.resets[0].mould, 8);
  EXPECT_EQ(records.resets[0].from_utime_us, 2'500'000);
  EXPECT_EQ(records.resets[1].note.who, "anna");
  EXPECT_EQ(records.resets[1].note.why, "shims set");
}

TEST_F(SearchTest, a_history_is_written_to_a_new_database_only) {
  make_four();
  close();
  const Result<std::unique_ptr<HistoryWriter>> writer = write_history(settings_);
  ASSERT_FALSE(writer.ok());
  EXPECT_EQ(writer.error().code, Code::config);
  EXPECT_NE(writer.error().text.view().find("exists"), std::string_view::npos);
}

}  // namespace
}  // namespace slabd::storage
