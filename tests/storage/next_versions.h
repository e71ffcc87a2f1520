// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "storage/files/upgrade.h"
#include "storage/storage.h"

namespace slabd::storage {

/// Two made-up schema versions after this program's, so that tests can upgrade a database. While it lives, this process
/// is a program of the last of them.
///   first step   adds table mould and column slab.mould
///   second step  needs the first: adds columns mould.wear_mm and item.mould_U, and makes table calibration again with
///                one more kind, because SQLite cannot widen a CHECK
class NextVersions {
 public:
  static constexpr int kFirst = kSchemaVersion + 1;
  static constexpr int kLast = kSchemaVersion + 2;

  /// `last`: kFirst or kLast.
  explicit NextVersions(int last = kLast) : NextVersions(last, second_step()) {}
  /// The second step is `second` instead.
  explicit NextVersions(const std::string& second) : NextVersions(kLast, second) {}

 private:
  NextVersions(int last, const std::string& second);
  [[nodiscard]] static std::string second_step();
  /// What a new database of these versions is made with.
  [[nodiscard]] static std::string fresh_text(int last);

  std::string text_;
  std::vector<std::string> steps_;
  std::vector<const char*> step_texts_;
  Schema schema_;
  SchemaOfTest in_force_;
};

}  // namespace slabd::storage
