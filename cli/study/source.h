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

/// Where the values of a study come from: scan files measured here and now by the daemon's code, stored slabs, tables.
namespace slabd::cli::study {

/// One value of one characteristic.
struct Reading {
  std::string item;  ///< as `slabctl show` names it; a table may name others
  int block = 0;     ///< 0: of the whole slab
  int block_to = 0;  ///< second block of a spacing or a pair
  double value = kNoValue;
  double lower = kNoValue;
  double upper = kNoValue;
  double U = kNoValue;
};
[[nodiscard]] Reading reading_of(const Item& item);
/// Judged by the same limits, or both by none: else their tolerance is not one tolerance.
[[nodiscard]] bool same_limits(const Reading& a, const Reading& b);
/// "1.3321 .. 1.5321", "at most 0.2", "at least 4", "none"
[[nodiscard]] std::string limits_text(const Reading& reading);
/// "seat_slope, block 3"
[[nodiscard]] std::string title_of(const Reading& reading);
/// "3", "3-4", "-"
[[nodiscard]] std::string block_text(int block, int block_to);
/// Decimals and unit that an item is shown with; four and none for one that slabd does not know.
[[nodiscard]] int decimals_of(const std::string& item);
[[nodiscard]] std::string unit_of(const std::string& item);
/// Who reads a table: people at a document in a language, who get words, or at a terminal, who get the names of options
/// and JSON.
using Reader = std::optional<report::Language>;
[[nodiscard]] std::string pick(Reader reader, std::string_view en, std::string_view zh);
/// The characteristic.
[[nodiscard]] std::string subject_of(const Reading& reading, Reader reader);
[[nodiscard]] std::string judgement_word(Judgement judgement, report::Language language);
/// The judgement with its symbol and `reason`; empty if it was not judged.
[[nodiscard]] Cell judged(Judgement judgement, const std::string& reason, Reader reader);
/// The order items are listed in: slabd's own, then the others.
[[nodiscard]] std::size_t rank_of(const std::string& item);

/// Everything measured in one go.
struct Take {
  std::string name;  ///< a file, a slab, the number of a run
  std::vector<Reading> readings;
};
/// Two takes that agree in every digit of every value (one at least) are one scan taken twice; its name, or empty.
/// Tables with few digits may agree by chance: not for them.
[[nodiscard]] std::string same_scan_twice(std::span<const Take> takes);

/// Measures scan files as `slabctl inspect` does. 72 MB and the workspace, once.
class ScanMeter {
 public:
  ScanMeter(const Recipe& recipe, const hal::ScanForm& form, int threads);
  /// The block's items; one that could not be measured has no value. `T_block_scanner`: where to look. config and the
  /// like: the file cannot be read.
  [[nodiscard]] Result<std::vector<Reading>> measure(const std::string& path, int block,
                                                     const Pose& T_block_scanner = nominal_T_block_scanner());
  /// Of the last scan that was measured.
  [[nodiscard]] const ScanShape& shape() const { return shape_; }

 private:
  Pages memory_;
  std::span<float> xyz_;
  hal::ScanForm form_;
  ScanShape shape_;
  std::unique_ptr<hal::Clock> clock_;
  algo::BlockInspector inspector_;
};

/// Scans named one by one, or all in the folders named, in the order of their names.
[[nodiscard]] Result<std::vector<std::string>> scan_files(const std::vector<std::string>& names);

/// The valid attempts of all blocks, and the items of the slab; those that SLAB_END judged anew count.
[[nodiscard]] Take take_of(const storage::SlabRecord& record);
/// One take for each attempt at a block, by station and number.
[[nodiscard]] std::vector<Take> attempts_of(const storage::SlabRecord& record);
/// All slabs that this means, oldest first: the one with this key, or the newest `limit` of this SLAB_ID that have
/// ended and were not aborted. Empty: there is none. config: it means two slabs.
[[nodiscard]] Result<std::vector<storage::SlabRecord>> slabs_named(storage::Reader& reader, const std::string& wanted,
                                                                   std::size_t limit);
/// What to say when there is none.
[[nodiscard]] Error no_slab_named(const std::string& wanted);

/// Takes from a table: columns item, value; optional run (else the n-th value of an item is run n), block, lower,
/// upper. config: also rows of one item and block with different limits.
[[nodiscard]] Result<std::vector<Take>> takes_of(const CsvTable& table);

// A study takes several measurements for those of one part. Slab ids, slab types, and the block that a scan's name or
// comment states can show that they are not; then the study is refused, unless the user states why they are one part.

/// The block that a scan's name states: "03-1.ply" (station and attempt, as slabd names its scans), "block7.ply",
/// "station-12_run2.pcd". nullopt if the name does not state one.
[[nodiscard]] std::optional<int> block_in_name(const std::string& path);

/// What every study prints about where its values come from.
struct StudyNotes {
  std::string same_part;             ///< what the user said (--same-part); empty: nothing had to be said
  std::vector<std::string> differs;  ///< what shows that they are several parts
  std::uint8_t emulated = 0;         ///< emulation bits of any of the measurements

  /// As sentences, for the terminal and for reports.
  [[nodiscard]] std::vector<std::string> sentences() const;
};
/// `same_part` (null, or why and differs), `emulated` and `emulation`.
void write_notes(Json& json, const StudyNotes& notes);

class SamePart {
 public:
  /// A stored slab that stands for `part`; "": the only one.
  void add_slab(const std::string& part, const SlabHeader& slab);
  /// A scan that is measured as `block` and stands for `part`.
  void add_scan(const std::string& part, const std::string& path, int block, const ScanShape& shape);

  /// Stops if several parts are taken for one, and `why` is empty.
  [[nodiscard]] StudyNotes settle(const std::string& why) const;

 private:
  struct Part {
    std::vector<std::string> ids;  ///< of slabs, each once
    std::vector<int> types;
    std::vector<int> blocks;  ///< that its scans are measured as
  };
  std::map<std::string, Part> parts_;
  std::vector<std::string> wrong_blocks_;
  unsigned emulated_ = 0;
  bool any_real_ = false;
};

}  // namespace slabd::cli::study
