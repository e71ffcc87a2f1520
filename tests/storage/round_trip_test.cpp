// SPDX-License-Identifier: Apache-2.0
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

class RoundTripTest : public StoreTest {};

TEST_F(RoundTripTest, slab_attempts_blocks_and_items_keep_their_bits) {
  open();
  for (std::int64_t key = 1; key <= 20; ++key) {
    const BeginSlabJob begun{random_header(prng_, key), session_, ++cmd_seq_};
    apply(begun);
    accept(PlcCommand::scan, 3, key);
    Attempt first = attempt(key, 3, 1);
    apply(FailedAttemptJob{first, 205});
    accept(PlcCommand::scan, 3, key);
    const Attempt second = attempt(key, 3, 2);
    apply(AcquiredJob{second});
    const BlockResult block = random_block(prng_, 3, Verdict::fail);
    apply(BlockJob{key, 2, block, random_record(prng_, ++res_seq_, 1)});
    const SlabResult slab = random_slab(prng_, Verdict::fail);
    apply(SlabJob{key, slab, random_record(prng_, ++res_seq_, 2), 987'654'321});

    Result<std::optional<SlabRecord>> read = reader()->slab(key);
    ASSERT_TRUE(read.ok()) << read.error().text.view();
    ASSERT_TRUE(read.value().has_value());
    const SlabRecord& record = *read.value();
    expect_same(record.summary.header, begun.slab);
    EXPECT_EQ(record.summary.ended_utime_us, 987'654'321);
    EXPECT_EQ(record.summary.verdict, Verdict::fail);
    EXPECT_EQ(record.summary.reason, slab.reason);
    EXPECT_EQ(record.summary.stations_measured, 1);
    EXPECT_FALSE(record.summary.acknowledged);
    expect_same(record.slab, slab);
    ASSERT_EQ(record.blocks.size(), 2U);
    expect_same(record.blocks[0].attempt, first);
    EXPECT_EQ(record.blocks[0].phase, StationPhase::failed);
    EXPECT_EQ(record.blocks[0].code, 205);
    EXPECT_EQ(record.blocks[0].block.verdict, Verdict::none);
    expect_same(record.blocks[1].attempt, second);
    EXPECT_EQ(record.blocks[1].phase, StationPhase::measured);
    expect_same(record.blocks[1].block, block);
    EXPECT_EQ(record.blocks[1].final_verdict, slab.station_verdict[2]);
    EXPECT_EQ(record.blocks[1].final_reason, slab.station_reason[2]);
  }
}

TEST_F(RoundTripTest, a_checksum_is_any_32_bits_or_none) {
  open();
  begin(1);
  std::uint8_t station = 0;
  for (const std::optional<std::uint32_t> crc :
       {std::optional<std::uint32_t>(0U), {0xFFFF'FFFFU}, {}, {0x8000'0000U}}) {
    accept(PlcCommand::scan, ++station, 1);
    Attempt a = attempt(1, station, 1);
    a.points_crc32c = crc;
    apply(AcquiredJob{a});
  }
  const auto read = reader()->slab(1);
  ASSERT_TRUE(read.ok());
  ASSERT_EQ(read.value()->blocks.size(), 4U);
  EXPECT_EQ(read.value()->blocks[0].attempt.points_crc32c, 0U);
  EXPECT_EQ(read.value()->blocks[1].attempt.points_crc32c, 0xFFFF'FFFFU);
  EXPECT_FALSE(read.value()->blocks[2].attempt.points_crc32c.has_value());
  EXPECT_EQ(read.value()->blocks[3].attempt.points_crc32c, 0x8000'0000U);
}

TEST_F(RoundTripTest, maps_keep_their_bytes_and_go_with_the_block_they_belong_to) {
  open();
  begin(1);
  acquire(1, 4, 1);
  BlockJob job{1, 1, random_block(prng_, 4, Verdict::pass), random_record(prng_, ++res_seq_, 1), random_maps(prng_)};
  apply(job);
  job.maps = random_maps(prng_);  // after an error the block is measured again
  apply(job);
  Result<std::unique_ptr<BlockMaps>> read = reader()->maps(1, 4, 1);
  ASSERT_TRUE(read.ok()) << read.error().text.view();
  expect_same(read.value()->registration, job.maps.registration);
  expect_same(read.value()->seat, job.maps.seat);

  job.maps = {};
  apply(job);
  read = reader()->maps(1, 4, 1);
  ASSERT_TRUE(read.ok()) << read.error().text.view();
  EXPECT_TRUE(read.value()->registration.empty()) << "a map of a measurement that was replaced";
  EXPECT_TRUE(read.value()->seat.empty());
}

TEST_F(RoundTripTest, the_noise_of_the_last_exposures_comes_back_with_the_line) {
  open();
  begin(1);
  acquire(1, 4, 1);
  BlockJob job{1, 1, random_block(prng_, 4, Verdict::pass), random_record(prng_, ++res_seq_, 1)};
  apply(job);
  EXPECT_TRUE(recover()->noise.empty()) << "the seat was not measured";

  const auto draw = [&] {
    job.noise = {};
    for (std::size_t i = 0; i < 3'000; ++i) job.noise.coarse.set(i, prng_.below(2) == 0);
    job.noise.places = 3'000;
  };
  draw();
  apply(job);
  draw();  // after an error the block is measured again
  apply(job);
  const auto line = recover();
  ASSERT_EQ(line->noise.size(), 1U);
  EXPECT_EQ(line->noise[0].slab_key, 1);
  EXPECT_EQ(line->noise[0].station, 4);
  EXPECT_EQ(line->noise[0].attempt, 1);
  EXPECT_EQ(to_bytes(line->noise[0].print), to_bytes(job.noise));
  EXPECT_EQ(line->noise[0].print.places, 3'000U);

  end(1, Verdict::fail);
  // The newest 64 of all slabs, oldest first.
  for (std::int64_t key = 2; key <= 5; ++key) {
    begin(key);
    for (int station = 1; station <= 18; ++station) {
      acquire(key, station, 1);
      job.slab_key = key;
      job.block = random_block(prng_, station, Verdict::pass);
      job.record = random_record(prng_, ++res_seq_, 1);
      apply(job);
    }
    end(key, Verdict::fail);
  }
  const auto full = recover();
  ASSERT_EQ(full->noise.size(), limits::kNoisePrintsKept);
  EXPECT_EQ(full->noise.front().slab_key, 2);
  EXPECT_EQ(full->noise.front().station, 9);
  EXPECT_EQ(full->noise.back().slab_key, 5);
  EXPECT_EQ(full->noise.back().station, 18);
}

TEST_F(RoundTripTest, results_keep_their_bits_and_their_order_over_a_wrap_of_the_sequence) {
  open();
  begin(1);
  std::vector<PlcResult> shown;
  std::uint16_t res_seq = 65'530;
  for (int station = 1; station <= 18; ++station) {
    acquire(1, station, 1);
    res_seq = next_sequence(res_seq);
    PlcResult record = random_record(prng_, res_seq, 1);
    record.station = static_cast<std::uint16_t>(station);
    shown.push_back(record);
    apply(BlockJob{1, 1, random_block(prng_, station, Verdict::pass), record});
  }
  const auto line = recover();
  ASSERT_EQ(line->unacknowledged.size(), shown.size());
  for (std::size_t i = 0; i < shown.size(); ++i) expect_same(line->unacknowledged[i], shown[i]);
  EXPECT_EQ(line->res_seq, res_seq);

  for (std::size_t i = 0; i <= 7; ++i) apply(AckJob{shown[i].res_seq});  // up to the first one after the wrap
  const auto rest = recover();
  ASSERT_EQ(rest->unacknowledged.size(), shown.size() - 8);
  expect_same(rest->unacknowledged.front(), shown[8]);
  apply(AckJob{shown[7].res_seq});
  apply(AckJob{4711});
  EXPECT_EQ(recover()->unacknowledged.size(), shown.size() - 8) << "a repeated or unknown acknowledgement does nothing";
}

TEST_F(RoundTripTest, minus_zero_comes_back_as_zero) {
  open();
  begin(1);
  accept(PlcCommand::scan, 1, 1);
  Attempt a = attempt(1, 1, 1);
  a.settle_ms = -0.0;
  apply(AcquiredJob{a});
  const auto line = recover();
  EXPECT_EQ(line->stations[0].attempt.settle_ms, 0.0);
  EXPECT_FALSE(std::signbit(line->stations[0].attempt.settle_ms)) << "the documented exception is no longer needed";
}

TEST_F(RoundTripTest, jobs_given_twice_leave_one_record) {
  open();
  apply(SessionJob{1});
  const BeginSlabJob begun{random_header(prng_, 1), session_, ++cmd_seq_};
  apply(begun);
  apply(begun);
  const CommandJob command{session_, ++cmd_seq_, 2, 5, 1, 42};
  apply(command);
  apply(command);
  const Attempt a = attempt(1, 5, 1);
  apply(AcquiredJob{a});
  apply(AcquiredJob{a});
  const BlockResult block = random_block(prng_, 5, Verdict::pass);
  PlcResult record = random_record(prng_, ++res_seq_, 1);
  record.station = 5;
  const BlockJob measured{1, 1, block, record};
  apply(measured);
  apply(measured);
  apply(AcquiredJob{a});  // late: the block stays measured
  const auto line = recover();
  EXPECT_EQ(line->unacknowledged.size(), 1U);
  EXPECT_EQ(line->stations[4].phase, StationPhase::measured);
  EXPECT_EQ(line->stations[4].attempts, 1);
  expect_same(line->stations[4].block, block);

  accept(PlcCommand::slab_end, 0, 1);
  const SlabJob ended{1, random_slab(prng_, Verdict::pass), random_record(prng_, ++res_seq_, 2), 99};
  apply(ended);
  SlabJob again = ended;  // after an error the daemon judges and numbers the slab again
  again.slab = random_slab(prng_, Verdict::indeterminate);
  again.record.res_seq = ++res_seq_;
  apply(again);
  const auto after = recover();
  EXPECT_EQ(after->unacknowledged.size(), 2U);
  EXPECT_EQ(after->unacknowledged[1].res_seq, again.record.res_seq);
  EXPECT_EQ(after->slab_verdict, Verdict::indeterminate);
  Result<std::optional<SlabRecord>> read = reader()->slab(1);
  ASSERT_TRUE(read.ok() && read.value().has_value());
  expect_same(read.value()->slab, again.slab);
}

TEST_F(RoundTripTest, contradictions_are_refused_and_the_store_continues) {
  open();
  EXPECT_FALSE(try_apply(AcquiredJob{attempt(1, 1, 1)}).ok()) << "no such slab";
  begin(5);
  Status status = try_apply(BeginSlabJob{random_header(prng_, 6), 1, 9});
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().text.view(), "slab 6 cannot begin: slab 5 is still open");
  status = try_apply(BlockJob{5, 1, random_block(prng_, 2, Verdict::pass), random_record(prng_, 1, 1)});
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, Code::journal_write);
  EXPECT_EQ(status.error().text.view(),
            "a block was measured for slab 5 station 2 attempt 1, which was never acquired");
  scan(5, 1, 1);
  status = try_apply(BeginSlabJob{random_header(prng_, 5), 1, 9});
  EXPECT_FALSE(status.ok()) << "a slab that has attempts is not begun again";
  end(5, Verdict::pass);
  status = try_apply(BeginSlabJob{random_header(prng_, 5), 1, 9});
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().text.view(), "slab key 5 is not above the last one, 5");
  begin(6);
}

}  // namespace
}  // namespace slabd::storage
