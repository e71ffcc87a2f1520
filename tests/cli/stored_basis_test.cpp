// SPDX-License-Identifier: Apache-2.0
//
// The basis with which a stored slab is judged again: the acceptance of each arm's scanner, and the tie.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>

#include "cli/replay/remeasure.h"
#include "slabctl_process.h"
#include "storage/storage.h"

namespace slabd::cli {
namespace {

class StoredBasisTest : public Slabctl {
 protected:
  StoredBasisTest() {
    settings_.db_path = file("slabd.db");
    settings_.spool_dir = file("spool");
  }
  std::string keep(const storage::CalibrationRecord& record) {
    auto store = storage::open_store(settings_);
    EXPECT_TRUE(store.ok()) << store.error().text.view();
    if (!store.ok()) return "";
    const Result<std::string> id = store.value()->change(storage::KeepCalibration{record});
    EXPECT_TRUE(id.ok()) << id.error().text.view();
    return id.ok() ? id.value() : "";
  }
  std::string keep_scanner(const std::string& scanner, double form_half_mm) {
    ScannerNumbers numbers;
    numbers.form_half_mm = form_half_mm;
    numbers.form_length_mm = 150.0;
    numbers.plates = 6;
    numbers.balls = 10;
    numbers.within_limits = true;
    storage::CalibrationRecord record;
    record.numbers = numbers;
    record.scanner = scanner;
    return keep(record);
  }
  std::string keep_tie() {
    TieNumbers numbers;
    numbers.robot = "2";
    numbers.T_base_robot.translation_mm = Vec3(0.0, 3'000.0, 0.0);
    numbers.centre_mm = Vec3(0.0, 1'500.0, 0.0);
    numbers.covariance = Mat6::Identity() * 1e-4;
    numbers.targets = 8;
    numbers.rms_mm = 0.05;
    storage::CalibrationRecord record;
    record.numbers = numbers;
    record.parent_id = "he-1+he-2";
    return keep(record);
  }
  storage::SlabRecord slab_of_two() {
    storage::SlabRecord record;
    SlabHeader& header = record.summary.header;
    header.scanner_id.assign(keep_scanner("1", 0.01));
    SlabArm second;
    second.by = {PartId("2"), PartId("right")};
    second.scanner_id.assign(keep_scanner("right", 0.02));
    EXPECT_TRUE(header.more_arms.push(second));
    header.tie_id.assign(keep_tie());
    return record;
  }
  StoredBasis basis(const storage::SlabRecord& record) {
    auto reader = storage::open_reader(settings_.db_path);
    EXPECT_TRUE(reader.ok());
    const auto basis = basis_of(*reader.value(), record, nullptr);
    EXPECT_TRUE(basis.ok());
    return basis.ok() ? basis.value() : StoredBasis{};
  }

  storage::StoreSettings settings_;
};

TEST_F(StoredBasisTest, contains_the_acceptance_of_each_scanner_and_the_tie) {
  const StoredBasis stored = basis(slab_of_two());
  EXPECT_TRUE(stored.missing.empty()) << stored.missing_text();
  EXPECT_EQ(stored.basis.verified[0].form_half_mm, 0.01);
  EXPECT_EQ(stored.basis.verified[1].form_half_mm, 0.02);
  ASSERT_TRUE(stored.basis.has_tie);
  EXPECT_EQ(stored.basis.tie.robot.view(), "2");
  EXPECT_EQ(stored.basis.tie.covariance(0, 0), 1e-4);
  EXPECT_EQ(stored.basis.tie.T_base_robot.translation_mm.y(), 3'000.0);
}

TEST_F(StoredBasisTest, has_no_tie_for_a_slab_by_one_robot) {
  storage::SlabRecord record;
  record.summary.header.scanner_id.assign(keep_scanner("1", 0.01));
  const StoredBasis stored = basis(record);
  EXPECT_TRUE(stored.missing.empty());
  EXPECT_FALSE(stored.basis.has_tie);
  EXPECT_EQ(stored.basis.verified[0].form_half_mm, 0.01);
  EXPECT_TRUE(std::isnan(stored.basis.verified[1].form_half_mm));
}

TEST_F(StoredBasisTest, names_a_record_that_is_missing) {
  storage::SlabRecord record = slab_of_two();
  record.summary.header.tie_id = "ti-ffffffffffff";
  StoredBasis stored = basis(record);
  ASSERT_EQ(stored.missing.size(), 1U);
  EXPECT_EQ(stored.missing_text(), "the tie ti-ffffffffffff is not in the database");
  EXPECT_FALSE(stored.basis.has_tie) << "then items across it have no budget";

  record.summary.header.more_arms[0].scanner_id = "sc-ffffffffffff";
  stored = basis(record);
  ASSERT_EQ(stored.missing.size(), 2U);
  EXPECT_EQ(stored.missing[0].what, "scanner acceptance");
  EXPECT_TRUE(std::isnan(stored.basis.verified[1].form_half_mm));
}

}  // namespace
}  // namespace slabd::cli
