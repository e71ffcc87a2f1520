// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/fields.h"
#include "cli/replay/verify.h"
#include "cli/replay/what_if.h"
#include "report/json.h"

/// Output of a replay from the results of its slabs. One process and the merge of several print with this code, so
/// that the same results give the same bytes.
namespace slabd::cli {

enum class ReplayKind : std::uint8_t {
  verify,   ///< every stored figure must be reproduced
  what_if,  ///< another recipe judges
};
[[nodiscard]] std::string_view name(ReplayKind kind);

/// Result of one slab. Both members are empty if the slab was deleted from the database after it had been selected.
struct ReplayRecord {
  std::optional<SlabReplay> verified;
  std::optional<WhatIfSlab> judged;
};

struct RecipeName {
  std::string name;
  std::string sha256;
  std::string file;
};
SLABD_FIELDS(RecipeName, name, sha256, file);

struct ReplayHead {
  ReplayKind kind = ReplayKind::verify;
  std::string software;
  int threads = 1;
  std::string instruction_set;
  RecipeName recipe;   ///< of ReplayKind::what_if
  bool named = false;  ///< the slabs were named, not selected by filters
};

/// Counts of the results, and the exit status that follows from them.
class ReplayCount {
 public:
  void add(const ReplayRecord& record);
  /// Text of a verification: "identical 4, differ 0, not verified 1".
  [[nodiscard]] std::string verified_text() const;
  /// Prints on stderr the number of slabs with scans and without a recipe, if there are any; returns the exit status.
  [[nodiscard]] int status(const ReplayHead& head) const;

  int identical = 0;
  int differs = 0;
  int not_verified = 0;
  int with_scans = 0;  ///< slabs that have scans, among those not verified
  int judged = 0;
  int left_out = 0;
};

class ReplayReport {
 public:
  ReplayReport(ReplayHead head, bool as_json);
  /// Adds the next slab. The text of a verification is printed at once.
  void add(ReplayRecord record);
  /// Prints the rest; returns the exit status.
  [[nodiscard]] int end();

 private:
  ReplayHead head_;
  bool as_json_;
  ReplayCount count_;
  report::Json json_;
  WhatIf what_if_;
};

/// Writes the slab as an object of slabd.replay/1.
void write_slab(report::Json& json, const SlabReplay& slab);

}  // namespace slabd::cli
