// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algo/algo.h"
#include "base/pages.h"
#include "config/config.h"
#include "storage/storage.h"

/// Stored scans measured again by the daemon's own path. Files and database are only read.
namespace slabd::cli {

struct Remeasured {
  enum class Scan : std::uint8_t {
    measured,    ///< `block` and `maps` are filled in, whatever the verdict
    pruned,      ///< no scan of this slab is there: the daemon deletes them together to keep its budget
    missing,     ///< it should be there
    unreadable,  ///< it is no scan (any more)
  };
  Scan scan = Scan::missing;
  std::string path;  ///< of the scan
  std::string
      note;  ///< one sentence: why there is no result, or what of the file is not as it was acquired; else empty
  std::optional<std::uint32_t> points_crc32c;  ///< of the points that were read
  bool proven = false;   ///< they are those that were measured: the checksum kept with the attempt says so
  bool altered = false;  ///< they are not: it says so, or there are more or fewer of them
  BlockResult block;
  BlockMaps maps;
};

class Remeasurer {
 public:
  /// `scans_dir`: a copy of the spool to look in when a scan does not lie where it was stored; empty: none. Takes the
  /// memory of one scan and of the measuring workspace.
  Remeasurer(int threads, const hal::ScanForm& form, std::string scans_dir);

  /// Builds the recipe's model, unless it is the one in use. `recipe` must outlive its use.
  void use(const Recipe& recipe);
  /// Measures the attempt's scan with the poses that are stored with it. `verified`: the scanner's acceptance that the
  /// slab was begun with.
  void measure(const SlabHeader& slab, const ScannerNumbers& verified, const storage::SlabBlock& stored,
               Remeasured& out);
  /// The file of the attempt's scan is there.
  [[nodiscard]] bool finds_scan(const storage::SlabBlock& stored) const;

 private:
  std::unique_ptr<hal::Clock> clock_;
  Pages memory_;
  std::span<float> xyz_;
  algo::BlockInspector inspector_;
  const Recipe* recipe_ = nullptr;
  hal::ScanForm form_;
  std::string scans_dir_;
};

/// The scanner's acceptance that the slab was begun with. Nothing: it is not in the database, or its numbers were
/// changed there. Without one the figures are all unknown, and the recipe's specification counts alone.
[[nodiscard]] Result<std::optional<ScannerNumbers>> scanner_of(storage::Reader& reader, const SlabHeader& slab);

/// What SLAB_END saw, attempt by attempt as the daemon keeps its stations, with `blocks[i]` in place of what was stored
/// of the i-th attempt (nullptr: what was stored).
[[nodiscard]] std::vector<StationRecord> stations_of(const storage::SlabRecord& record,
                                                     std::span<const BlockResult* const> blocks);

/// Where an attempt's scan lies today: where it was stored, or under the same folder and name below `scans_dir`.
[[nodiscard]] std::string scan_at(const storage::SlabBlock& stored, const std::string& scans_dir);

/// All recipes that can be read in a folder; `problems` names the others.
[[nodiscard]] std::vector<Recipe> recipes_in(const std::string& dir, std::vector<daemon::Problem>& problems);
}  // namespace slabd::cli
