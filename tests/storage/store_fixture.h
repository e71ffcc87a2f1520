// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "base/prng.h"
#include "storage/storage.h"

/// A fresh folder, a store in it, and records with every field filled.
namespace slabd::storage {

/// A folder of its own, deleted at the end. `where`: in this folder, if there is one.
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
  /// (Re)opens the store, as a restarted daemon would.
  void open();
  void close() { store_.reset(); }
  /// Applies and expects success.
  void apply(const decltype(StoreJob::what)& what);
  [[nodiscard]] Status try_apply(const decltype(StoreJob::what)& what);
  [[nodiscard]] std::unique_ptr<RecoveredLine> recover();
  [[nodiscard]] std::unique_ptr<Reader> reader();

  /// A scan file of this size in the spool; returns its path.
  [[nodiscard]] std::string scan_file(std::int64_t slab_key, int station, int attempt, std::size_t bytes);

  // What the daemon does, job by job. Each uses the next command sequence number.
  void begin(std::int64_t slab_key, std::uint32_t slab_no = 77);
  void accept(PlcCommand command, int station, std::int64_t slab_key);
  /// Of the last accepted SCAN.
  [[nodiscard]] Attempt attempt(std::int64_t slab_key, int station, int number);
  void acquire(std::int64_t slab_key, int station, int number);
  /// accept, acquire and measure; returns the record's RES_SEQ.
  std::uint16_t scan(std::int64_t slab_key, int station, int number, Verdict verdict = Verdict::pass);
  std::uint16_t measure(std::int64_t slab_key, int station, int number, Verdict verdict = Verdict::pass);
  /// accept SLAB_END and store the verdict; returns the record's RES_SEQ.
  std::uint16_t end(std::int64_t slab_key, Verdict verdict);
  /// Everything that waits, up to this record, one after the other.
  void acknowledge(std::uint16_t res_seq);

  TemporaryFolder folder_;
  StoreSettings settings_;
  std::unique_ptr<Store> store_;
  Prng prng_{20'240'501};
  std::uint16_t session_ = 1;
  std::uint16_t cmd_seq_ = 0;
  std::uint16_t res_seq_ = 0;
};

// Every field different from its default and from its neighbours; some numbers are NaN, as real ones are.
[[nodiscard]] SlabHeader random_header(Prng& prng, std::int64_t key);
[[nodiscard]] Attempt random_attempt(Prng& prng, std::int64_t slab_key, int station, int number);
[[nodiscard]] BlockMaps random_maps(Prng& prng);
[[nodiscard]] BlockResult random_block(Prng& prng, int station, Verdict verdict);
[[nodiscard]] SlabResult random_slab(Prng& prng, Verdict verdict);
[[nodiscard]] PlcResult random_record(Prng& prng, std::uint16_t res_seq, std::uint16_t kind);

// Bit for bit; NaN equals NaN. Written out field by field, so that a field forgotten by storage is noticed here.
void expect_same(const SlabHeader& a, const SlabHeader& b);
void expect_same(const Attempt& a, const Attempt& b);
void expect_same(const PackedMap& a, const PackedMap& b);
void expect_same(const BlockResult& a, const BlockResult& b);
void expect_same(const SlabResult& a, const SlabResult& b);
void expect_same(const PlcResult& a, const PlcResult& b);

}  // namespace slabd::storage
