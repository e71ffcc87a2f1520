// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "base/prng.h"
#include "storage/storage.h"

/// Test fixture: a new folder, a store in it, and records with all fields set.
namespace slabd::storage {

/// A temporary folder, deleted at the end. `where`: its parent, if that exists.
class TemporaryFolder {
 public:
  explicit TemporaryFolder(const std::string& where = "");
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

class StoreTest : public ::testing::Test {
 protected:
  StoreTest();
  /// Opens the store (again), like a restarted daemon.
  void open();
  void close() { store_.reset(); }
  /// Applies a job and expects success.
  void apply(const decltype(StoreJob::what)& what);
  [[nodiscard]] Status try_apply(const decltype(StoreJob::what)& what);
  [[nodiscard]] std::unique_ptr<RecoveredLine> recover();
  [[nodiscard]] std::unique_ptr<Reader> reader();

  /// Creates a scan file of this size in the spool and returns its path.
  [[nodiscard]] std::string scan_file(std::int64_t slab_key, int station, int attempt, std::size_t bytes);

  // Actions of the daemon, job by job. Each uses the next command sequence number.
  void begin(std::int64_t slab_key, std::uint32_t slab_no = 77);
  void accept(PlcCommand command, int station, std::int64_t slab_key);
  /// Attempt of the last accepted SCAN.
  [[nodiscard]] Attempt attempt(std::int64_t slab_key, int station, int number);
  void acquire(std::int64_t slab_key, int station, int number);
  /// Accepts, acquires and measures; returns the record's RES_SEQ.
  std::uint16_t scan(std::int64_t slab_key, int station, int number, Verdict verdict = Verdict::pass);
  std::uint16_t measure(std::int64_t slab_key, int station, int number, Verdict verdict = Verdict::pass);
  /// Accepts SLAB_END and stores the verdict; returns the record's RES_SEQ.
  std::uint16_t end(std::int64_t slab_key, Verdict verdict);
  /// Acknowledges all waiting records up to this one, in order.
  void acknowledge(std::uint16_t res_seq);

  TemporaryFolder folder_;
  StoreSettings settings_;
  std::unique_ptr<Store> store_;
  Prng prng_{20'240'501};
  std::uint16_t session_ = 1;
  std::uint16_t cmd_seq_ = 0;
  std::uint16_t res_seq_ = 0;
};

// Random records: every field differs from its default and from its neighbours; some numbers are NaN, like real ones.
[[nodiscard]] SlabHeader random_header(Prng& prng, std::int64_t key);
[[nodiscard]] Attempt random_attempt(Prng& prng, std::int64_t slab_key, int station, int number);
[[nodiscard]] BlockMaps random_maps(Prng& prng);
[[nodiscard]] BlockResult random_block(Prng& prng, int station, Verdict verdict);
[[nodiscard]] SlabResult random_slab(Prng& prng, Verdict verdict);
[[nodiscard]] PlcResult random_record(Prng& prng, std::uint16_t res_seq, std::uint16_t kind);

// Bitwise comparison; NaN equals NaN. Written field by field, so that a field forgotten by storage is detected here.
void expect_same(const SlabHeader& a, const SlabHeader& b);
void expect_same(const Attempt& a, const Attempt& b);
void expect_same(const PackedMap& a, const PackedMap& b);
void expect_same(const BlockResult& a, const BlockResult& b);
void expect_same(const GaugeReading& a, const GaugeReading& b);
void expect_same(const SlabResult& a, const SlabResult& b);
void expect_same(const PlcResult& a, const PlcResult& b);

}  // namespace slabd::storage
