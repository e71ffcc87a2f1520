// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/jobs.h"
#include "report/json.h"

/// A study takes several measurements for those of one part. Slab ids, slab types, and the block that a scan's name or
/// comment states can show that they are not; then the study is refused, unless the user states why they are one part.
namespace slabd::cli::study {

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
