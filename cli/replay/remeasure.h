// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "algo/algo.h"
#include "base/pages.h"
#include "cli/terminal/parse.h"
#include "config/config.h"
#include "storage/storage.h"

/// Measures stored scans again with the code of the daemon. Files and database are only read.
namespace slabd::cli {

struct Remeasured {
  enum class Scan : std::uint8_t {
    measured,    ///< `block` and `maps` are set, for any verdict
    pruned,      ///< the slab has no scans: the daemon deletes them together to keep its budget
    missing,     ///< the scan should exist, but does not
    unreadable,  ///< the file is not a valid scan
  };
  Scan scan = Scan::missing;
  std::string path;  ///< path of the scan
  std::string note;  ///< one sentence: the reason for a missing result, or changes of the file; otherwise empty
  std::optional<std::uint32_t> points_crc32c;  ///< checksum of the points that were read
  bool proven = false;   ///< the checksum stored with the attempt proves that the points are unchanged
  bool altered = false;  ///< the points are changed, by checksum or by number
  BlockResult block;
  BlockMaps maps;
};

/// True if `stored` is the reason for which slabd did not use this scan, or the end of a process that measured it. It
/// came from other scans or from the process, so that the scan's points do not give it again.
[[nodiscard]] bool was_refused(const BlockResult& stored, const BlockResult& now);

/// The form of each scanner's files, by its id.
class ScanForms {
 public:
  ScanForms() = default;
  /// Those of the configuration; values of `given` are for all scanners.
  ScanForms(const config::Config& config, const ScanFormOptions& given);

  /// That of the scanner of this attempt; for one that is not configured, that of the first scanner.
  [[nodiscard]] const hal::ScanForm& of(const Attempt& attempt) const;
  /// Unit and columns in words, as options name them; those of several scanners that differ are joined by '+'.
  [[nodiscard]] std::string unit() const;
  [[nodiscard]] std::string columns() const;

 private:
  [[nodiscard]] std::string joined(std::string ScanFormOptions::*part) const;

  hal::ScanForm other_;
  std::vector<std::pair<PartId, hal::ScanForm>> of_scanner_;
};

class Remeasurer {
 public:
  /// `scans_dir`: a copy of the spool for scans that are no longer at their stored path; may be empty. Allocates
  /// memory for one scan and the measuring workspace.
  Remeasurer(int threads, ScanForms forms, std::string scans_dir);

  /// Builds the recipe's model, unless it is the current one. `recipe` must outlive its use.
  void use(const Recipe& recipe);
  /// Measures the attempt's scan with the poses stored with it, and the acceptance of its scanner in `basis`.
  void measure(const SlabHeader& slab, const SlabBasis& basis, const storage::SlabBlock& stored, Remeasured& out);
  /// True if the file of the attempt's scan exists.
  [[nodiscard]] bool finds_scan(const storage::SlabBlock& stored) const;

 private:
  std::unique_ptr<hal::Clock> clock_;
  Pages memory_;
  std::span<float> xyz_;
  algo::BlockInspector inspector_;
  const Recipe* recipe_ = nullptr;
  ScanForms forms_;
  std::string scans_dir_;
};

/// Acceptance of an arm's scanner at the begin of the slab. nullopt: it is not in the database, or its numbers were
/// changed there. If the slab had none, all figures are unknown, and only the recipe's specification applies.
[[nodiscard]] Result<std::optional<ScannerNumbers>> scanner_of(storage::Reader& reader, const SlabHeader& slab,
                                                               std::size_t arm = 0);

/// Basis of a stored slab, from the records that it was begun with.
struct StoredBasis {
  SlabBasis basis;
  struct Missing {
    std::string what;  ///< "scanner acceptance" or "tie"
    std::string id;
  };
  std::vector<Missing> missing;  ///< records that are not in the database, or whose numbers were changed there
  /// "the scanner acceptance sc-... is not in the database", for the first of them.
  [[nodiscard]] std::string missing_text() const;
};
/// The basis with `recipe`. A missing acceptance counts as none, a missing tie as one of unknown uncertainty.
[[nodiscard]] Result<StoredBasis> basis_of(storage::Reader& reader, const storage::SlabRecord& record,
                                           const Recipe* recipe);

/// Input of SLAB_END: the stations by attempts, as in the daemon, with `blocks[i]` instead of the stored i-th attempt
/// (nullptr: the stored one).
[[nodiscard]] std::vector<StationRecord> stations_of(const storage::SlabRecord& record,
                                                     std::span<const BlockResult* const> blocks);

/// Current path of an attempt's scan: where it was stored, or under the same folder and name below `scans_dir`. If it
/// is at neither, its archive (with .slabz added) at one of them.
[[nodiscard]] std::string scan_at(const storage::SlabBlock& stored, const std::string& scans_dir);

/// All readable recipes of a folder; `problems` lists the others.
[[nodiscard]] std::vector<Recipe> recipes_in(const std::string& dir, std::vector<config::Problem>& problems);
}  // namespace slabd::cli
