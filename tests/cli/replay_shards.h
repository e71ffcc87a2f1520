// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <map>
#include <vector>

#include "cli/exit.h"
#include "daemon/measure.h"
#include "tests/cli/stored_slab.h"
#include "tests/places/places.h"

/// Several stored slabs with their scans, for replays in shards.
namespace slabd::cli {

inline constexpr int kShards = 3;

/// Slab 1 was measured; 2 to 5 have copies of its results. Of slab 2 a scan is missing, of slab 3 all scans.
struct ReplayShards : StoredSlab {
  void SetUp() override {
    begin();
    measure(3);
    measure(4, "--defect jaw-distance=4:0.9");
    end();
    for (int key = 2; key <= 5; ++key) add_copy(key);
    fs::remove(file("spool/2/03-1.ply"));
    fs::remove_all(file("spool/3"));
    std::string recipe = content(kRecipe);
    const std::string narrow = "nominal = 380\ntolerance = 0.5";
    const std::size_t at = recipe.find(narrow);
    ASSERT_NE(at, std::string::npos);
    wider_ = write("wider.toml", recipe.replace(at, narrow.size(), "nominal = 380\ntolerance = 2.0"));
  }
  void add_copy(int key) {
    header_.key = key;
    header_.slab_id.assign("SLAB \"" + std::to_string(key) + "\"");
    header_.began_utime_us += 1'000'000'000;
    begin();
    const std::string folder = file("spool/" + std::to_string(key));
    fs::create_directory(folder);
    for (const auto& scan : fs::directory_iterator(file("spool/1"))) {
      const std::string to = folder + "/" + scan.path().filename().string();
      if (scans_are_links_)
        fs::create_hard_link(scan.path(), to);
      else
        fs::copy(scan.path(), to);
    }
    for (const int station : {3, 4}) {
      const StationRecord& of_first = stations_[static_cast<std::size_t>(station - 1)];
      Attempt attempt = of_first.attempt;
      attempt.slab_key = key;
      const std::string name = fs::path(std::string(attempt.scan_path.view())).filename();
      attempt.scan_path.assign(file("spool/" + std::to_string(key) + "/" + name));
      apply(AcquiredJob{attempt});
      BlockJob block;
      block.slab_key = key;
      block.attempt = attempt.number;
      block.block = of_first.block;
      block.record.kind = 1;
      block.record.res_seq = static_cast<std::uint16_t>(1'000 * key + station);
      block.record.station = static_cast<std::uint8_t>(station);
      apply(block);
    }
    std::vector<BlockResult> room(limits::kStationsMax);
    SlabJob slab;
    slab.slab_key = key;
    daemon::judge_slab({&recipe_, header_.T_base_slab, {}, facts_of(header_), false, {}}, stations_, room, slab.slab);
    slab.record.kind = 2;
    slab.record.res_seq = static_cast<std::uint16_t>(1'000 * key + 999);
    slab.ended_utime_us = header_.began_utime_us + 500'000'000;
    apply(slab);
    store_.reset();
  }

  /// The command without --shard: `what` is --verify or --recipe.
  [[nodiscard]] std::string all(const std::string& what) const { return "replay --all --db " + db() + " " + what; }
  [[nodiscard]] std::string verify() const { return all("--verify --recipes " + places::source_dir() + "/recipes"); }
  [[nodiscard]] std::string what_if() const { return all("--recipe " + wider_); }
  [[nodiscard]] Ended run_shard(const std::string& command, int index, const std::string& out) const {
    return run(command + " --shard " + std::to_string(index) + "/" + std::to_string(kShards) + " --out " + file(out));
  }
  void run_shards(const std::string& command, const std::string& out, std::vector<int> order = {1, 2, 3}) const {
    for (const int index : order) {
      const Ended ended = run_shard(command, index, out);
      ASSERT_LE(ended.status, kNotPass) << ended.err;
      expect_mentions(ended.out, "shard " + std::to_string(index) + "/3: ");
    }
  }
  [[nodiscard]] Ended merge(const std::string& dir, const std::string& more = "") const {
    return run("replay --merge " + file(dir) + " " + more);
  }
  [[nodiscard]] std::map<std::string, std::string> files(const std::string& dir) const {
    std::map<std::string, std::string> found;
    for (const auto& entry : fs::directory_iterator(file(dir)))
      found[entry.path().filename().string()] = content(entry.path());
    return found;
  }
  void put(const std::string& name, const std::string& text) const { static_cast<void>(write(name, text)); }
  /// Name of the file of slab `key`.
  [[nodiscard]] std::string slab_file(const std::string& dir, int key) const {
    for (const auto& [name, text] : files(dir))
      if (name.starts_with(std::to_string(key) + "-")) return name;
    return "none";
  }
  [[nodiscard]] std::string selection_file(const std::string& dir) const {
    for (const auto& [name, text] : files(dir))
      if (name.starts_with("selection-")) return name;
    return "none";
  }

  bool scans_are_links_ = false;  ///< many slabs need no more disk than one
  std::string wider_;             ///< recipe with a wider limit, in a file
};

}  // namespace slabd::cli
