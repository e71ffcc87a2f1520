// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algo/algo.h"
#include "base/base.h"
#include "base/jobs.h"
#include "base/pages.h"
#include "cli/study/csv.h"
#include "cli/study/statistics.h"
#include "hal/hal.h"
#include "report/json.h"
#include "report/table.h"
#include "report/words.h"
#include "storage/storage.h"

/// Sources of a study's values: scan files measured by the daemon's code, stored slabs, tables.
namespace slabd::cli::study {

/// One value of one characteristic.
struct Reading {
  std::string item;  ///< named as in `slabctl show`; a table may contain other names
  int block = 0;     ///< 0: of the whole slab
  int block_to = 0;  ///< second block of a spacing or a pair
  double value = kNoValue;
  double lower = kNoValue;
  double upper = kNoValue;
  double U = kNoValue;
};
[[nodiscard]] Reading reading_of(const Item& item);
/// True if both have the same limits or none; otherwise they have no common tolerance.
[[nodiscard]] bool same_limits(const Reading& a, const Reading& b);
/// "1.3321 .. 1.5321", "at most 0.2", "at least 4", "none"
[[nodiscard]] std::string limits_text(const Reading& reading);
/// "seat_slope, block 3"
[[nodiscard]] std::string title_of(const Reading& reading);
/// "3", "3-4", "-"
[[nodiscard]] std::string block_text(int block, int block_to);
/// Decimals and unit of an item; four and none for an unknown item.
[[nodiscard]] int decimals_of(const std::string& item);
[[nodiscard]] std::string unit_of(const std::string& item);
/// Reader of a table: a language for a document, which contains words; nullopt for the terminal, which has the names
/// of options and JSON.
using Reader = std::optional<report::Language>;
[[nodiscard]] std::string pick(Reader reader, std::string_view en, std::string_view zh);
/// Text of the characteristic.
[[nodiscard]] std::string subject_of(const Reading& reading, Reader reader);
[[nodiscard]] std::string judgement_word(Judgement judgement, report::Language language);
/// The judgement with its symbol and `reason`; empty if it was not judged.
[[nodiscard]] report::Cell judged(Judgement judgement, const std::string& reason, Reader reader);
/// Sort order of items: slabd's own, then the others.
[[nodiscard]] std::size_t rank_of(const std::string& item);

/// All values of one measurement.
struct MeasuredOnce {
  std::string name;  ///< file, slab, or number of a run
  std::vector<Reading> readings;
};
/// Two takes with equal digits in all values (at least one) are one scan taken twice: its name, or empty. Not for
/// tables, because with few digits values may be equal by chance.
[[nodiscard]] std::string same_scan_twice(std::span<const MeasuredOnce> measurements);

/// Measures scan files as `slabctl inspect` does. Allocates 72 MB and the workspace once.
class ScanMeter {
 public:
  ScanMeter(const Recipe& recipe, const hal::ScanForm& form, int threads);
  /// The block's items; an item that could not be measured has no value. `T_block_scanner`: start pose. Returns the
  /// reader's error if the file cannot be read.
  [[nodiscard]] Result<std::vector<Reading>> measure(const std::string& path, int block,
                                                     const Pose& T_block_scanner = nominal_T_block_scanner());
  /// Shape of the last measured scan.
  [[nodiscard]] const ScanShape& shape() const { return shape_; }

 private:
  Pages memory_;
  std::span<float> xyz_;
  hal::ScanForm form_;
  ScanShape shape_;
  std::unique_ptr<hal::Clock> clock_;
  algo::BlockInspector inspector_;
};

/// Named scan files, and all scans in named folders, sorted by name.
[[nodiscard]] Result<std::vector<std::string>> scan_files(const std::vector<std::string>& names);

/// The valid attempts of all blocks, and the items of the slab. Items that SLAB_END computed again replace the
/// block's.
[[nodiscard]] MeasuredOnce measurement_of(const storage::SlabRecord& record);
/// One take per attempt at a block, by station and number.
[[nodiscard]] std::vector<MeasuredOnce> attempts_of(const storage::SlabRecord& record);
/// All slabs of this name, oldest first: the one with this key, or the newest `limit` of this SLAB_ID that have ended
/// and were not aborted. May be empty. Code::config: the name is ambiguous.
[[nodiscard]] Result<std::vector<storage::SlabRecord>> slabs_named(storage::Reader& reader, const std::string& wanted,
                                                                   std::size_t limit);
/// Error for a name without a slab.
[[nodiscard]] Error no_slab_named(const std::string& wanted);

/// Takes from a table: columns item, value; optional run (default: the n-th value of an item is run n), block, lower,
/// upper. Code::config also if rows of one item and block have different limits.
[[nodiscard]] Result<std::vector<MeasuredOnce>> measurements_of(const CsvTable& table);

// A study assumes that several measurements are of one part. Slab ids, slab types, and the block in a scan's name or
// comment can contradict this; then the study is rejected, unless the user states a reason.

/// The block number in a scan's name: "03-1.ply" (station and attempt, as slabd names its scans), "block7.ply",
/// "station-12_run2.pcd". nullopt if there is none.
[[nodiscard]] std::optional<int> block_in_name(const std::string& path);

/// Notes on the source of the values, printed by every study.
struct StudyNotes {
  std::string same_part;             ///< the user's reason (--same-part); empty if none was needed
  std::vector<std::string> differs;  ///< differences that indicate several parts
  std::uint8_t emulated = 0;         ///< emulation bits of any of the measurements

  /// Notes as sentences, for the terminal and for reports.
  [[nodiscard]] std::vector<std::string> sentences() const;
};
/// `same_part` (null, or why and differs), `emulated` and `emulation`.
void write_notes(report::Json& json, const StudyNotes& notes);

class SamePart {
 public:
  /// Adds a stored slab that represents `part`; "": the only part.
  void add_slab(const std::string& part, const SlabHeader& slab);
  /// Adds a scan that is measured as `block` and represents `part`.
  void add_scan(const std::string& part, const std::string& path, int block, const ScanShape& shape);

  /// Stops if measurements are of several parts, and `why` is empty.
  [[nodiscard]] StudyNotes settle(const std::string& why) const;

 private:
  struct Part {
    std::vector<std::string> ids;  ///< different ids of slabs
    std::vector<int> types;
    std::vector<int> blocks;  ///< blocks as which its scans are measured
  };
  std::map<std::string, Part> parts_;
  std::vector<std::string> wrong_blocks_;
  unsigned emulated_ = 0;
  bool any_real_ = false;
};

}  // namespace slabd::cli::study
