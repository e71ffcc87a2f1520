// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "storage/files/upgrade.h"
#include "storage/storage.h"

namespace slabd::storage {

/// Two invented schema versions after this program's, so that tests can upgrade a database. During its lifetime this
/// process acts as a program of the later one.
///   first step: adds table batch and column slab.batch
///   second step: requires the first; adds columns batch.strength and item.batch_U, and rebuilds table calibration with
///     an additional kind, because SQLite cannot extend a CHECK
class NextVersions {
 public:
  static constexpr int kFirst = kSchemaVersion + 1;
  static constexpr int kLast = kSchemaVersion + 2;

  /// `last`: kFirst or kLast.
  explicit NextVersions(int last = kLast) : NextVersions(last, second_step()) {}
  /// Uses `second` as the second step.
  explicit NextVersions(const std::string& second) : NextVersions(kLast, second) {}

 private:
  NextVersions(int last, const std::string& second);
  [[nodiscard]] static std::string second_step();
  /// Schema text of a new database of these versions.
  [[nodiscard]] static std::string fresh_text(int last);

  std::string text_;
  std::vector<std::string> steps_;
  std::vector<const char*> step_texts_;
  Schema schema_;
  SchemaOfTest in_force_;
};

}  // namespace slabd::storage
