// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "algo/algo.h"
#include "base/jobs.h"
#include "base/pages.h"
#include "config/config.h"
#include "daemon/measure.h"
#include "storage/storage.h"
#include "tests/cli/slabctl_process.h"

/// A slab in a database with its scans, measured and judged as by the daemon, but with a few stations only, so that
/// tests of commands take seconds.
namespace slabd::cli {

class StoredSlab : public Slabctl {
 protected:
  StoredSlab() {
    std::vector<config::Problem> problems;
    config::load_recipe(kRecipe, recipe_, problems);
    EXPECT_TRUE(problems.empty());
    header_.key = 1;
    header_.slab_id = "SLAB-0042";
    header_.slab_no = 42;
    header_.slab_type = recipe_.slab_type;
    header_.stations = recipe_.stations();
    header_.recipe = recipe_.name;
    header_.recipe_sha256 = recipe_.sha256;
    header_.guard = recipe_.guard;
    header_.cell_mm = recipe_.evaluation.cell_mm;
    header_.unconfirmed = static_cast<std::uint16_t>(unconfirmed_count(recipe_));
    header_.calibration_id = "commissioning-0123456789ab";
    header_.software = daemon::software_version();
    header_.T_base_slab.translation_mm = Vec3(1800.0, 3.25, 300.0);
    header_.T_flange_scanner.translation_mm = Vec3(0.0, 80.0, 150.0);
    header_.began_utime_us = 1'763'681'281'000'000;
    auto opened = storage::open_store({db(), file("spool"), 0});
    EXPECT_TRUE(opened.ok()) << opened.error().text.view();
    store_ = std::move(opened.value());
  }

  [[nodiscard]] std::string db() const { return file("slabd.db"); }
  [[nodiscard]] std::string scan(int station, int attempt = 1) const {
    char name[32];
    std::snprintf(name, sizeof name, "%02d-%d.ply", station, attempt);
    return file("spool/1/" + std::string(name));
  }
  void apply(const decltype(StoreJob::what)& what) {
    const Status status = store_->apply({1, what});
    ASSERT_TRUE(status.ok()) << status.error().text.view();
  }

  void begin() {
    if (keeps_proof_) {
      store_.reset();
      storage::StoreSettings settings{db(), file("spool"), 0};
      settings.recipe_texts = {{recipe_.sha256, recipe_.name, content(kRecipe)}};
      store_ = std::move(storage::open_store(settings).value());
    }
    apply(BeginSlabJob{header_, 1, 1});
    fs::create_directories(file("spool/1"));
  }
  /// Draws a scan of the station and measures it.
  void measure(int station, const std::string& more = "", int number = 1) {
    const Ended drawn = run("simulate scan --points quarter --recipe " + kRecipe + " --block " +
                            std::to_string(station) + " --out " + scan(station, number) + " " + more);
    ASSERT_EQ(drawn.status, 0) << drawn.err;
    const Result<ScanShape> shape = hal::read_scan(scan(station, number).c_str(), hal::LengthUnit::mm, xyz_);
    ASSERT_TRUE(shape.ok()) << shape.error().text.view();
    Attempt attempt;
    attempt.slab_key = 1;
    attempt.station = static_cast<std::uint8_t>(station);
    attempt.number = static_cast<std::uint8_t>(number);
    attempt.session = 1;
    attempt.cmd_seq = static_cast<std::uint16_t>(station);
    attempt.scan_path.assign(scan(station, number));
    attempt.shape = shape.value();
    if (keeps_proof_) attempt.points_crc32c = hal::points_crc32c(xyz_.first(3 * shape.value().points)) ^ crc_error_;
    attempt.scan_utime_us = 4'000'000'000'000'000;  // in the far future: files are never newer
    attempt.splice.source = SpliceSource::commissioning;
    attempt.splice.calibration_mm = 0.02;
    attempt.splice.calibration_rad = 2e-5;
    attempt.splice.robot_mm = 0.0;
    attempt.splice.robot_rad = 0.0;
    const Pose T_base_block = header_.T_base_slab * T_slab_block(recipe_, station);
    attempt.T_base_flange = T_base_block * nominal_T_block_scanner() * header_.T_flange_scanner.inverse();
    apply(AcquiredJob{attempt});

    const algo::Cloud cloud{xyz_, shape.value().points, shape.value().width, shape.value().height};
    static_cast<void>(daemon::measure_block(inspector(), *clock_, station, T_base_block,
                                            stored_T_base_scanner(header_, attempt), cloud, shape.value(), 0.0));
    BlockJob job;
    job.slab_key = 1;
    job.attempt = attempt.number;
    job.block = inspector().result();
    daemon::pack_maps(inspector(), job.maps);
    job.record.kind = 1;
    job.record.res_seq = static_cast<std::uint16_t>(10 * station + number);
    job.record.station = static_cast<std::uint8_t>(station);
    apply(job);
    StationRecord& record = stations_[static_cast<std::size_t>(station - 1)];
    record.phase = StationPhase::measured;
    record.attempt = attempt;
    record.block = job.block;
  }
  void end() {
    std::vector<BlockResult> room(limits::kStationsMax);
    SlabJob job;
    job.slab_key = 1;
    daemon::judge_slab({&recipe_, header_.T_base_slab, {}, facts_of(header_), false, {}}, stations_, room, job.slab);
    job.record.kind = 2;
    job.record.res_seq = 999;
    job.ended_utime_us = 1'763'681'999'000'000;
    apply(job);
    store_.reset();
  }

  algo::BlockInspector& inspector() {
    if (!inspector_) {
      inspector_ = std::make_unique<algo::BlockInspector>(1);
      inspector_->use(recipe_);
    }
    return *inspector_;
  }

  bool keeps_proof_ = true;      ///< stores checksums and the recipe's file
  std::uint32_t crc_error_ = 0;  ///< error of the stored checksum, as if other points had been measured
  Recipe recipe_;
  SlabHeader header_;
  std::vector<StationRecord> stations_ = std::vector<StationRecord>(limits::kStationsMax);
  std::unique_ptr<storage::Store> store_;

 private:
  std::unique_ptr<hal::Clock> clock_ = hal::make_system_clock();
  Pages memory_ = Pages(limits::kScanSlotBytes);
  std::span<float> xyz_ = memory_.take<float>(limits::kScanPointsMax * 3);
  std::unique_ptr<algo::BlockInspector> inspector_;
};

}  // namespace slabd::cli
