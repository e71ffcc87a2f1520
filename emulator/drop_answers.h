// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <set>
#include <string>

#include "base/result.h"
#include "hal/hal.h"

/// The scanner software's side of a drop directory: which request waits, and how an answer gets into the inbox. One
/// thread uses it.
namespace slabd::simulate {

class DropAnswers {
 public:
  /// scanner_offline when the folder has no request/ and inbox/ that can be used (the daemon makes them). Requests that
  /// already lie there were meant for another scanner and are left alone.
  [[nodiscard]] static Result<DropAnswers> open(const std::string& drop_dir);

  /// "<session>-<seq>" of a request that was not answered yet, or empty. `trouble` is set when one cannot be read.
  [[nodiscard]] std::string pending(std::string& trouble);
  /// Where to write a scan before it is delivered; on the inbox's file system. Removed with remove_part().
  [[nodiscard]] const std::filesystem::path& part_path() const { return part_path_; }
  /// Moves the scan at part_path() into the inbox as the answer to `name`, which then waits no more. scanner_offline:
  /// it could not be moved.
  [[nodiscard]] Status deliver(const std::string& name, hal::ScanFormat format);
  /// Nothing will be delivered for it.
  void give_up(const std::string& name) { answered_.insert(name); }
  void remove_part() const;

 private:
  std::filesystem::path request_dir_;
  std::filesystem::path inbox_dir_;
  std::filesystem::path part_path_;
  std::set<std::string> answered_;
};

/// What a length in mm is multiplied with.
[[nodiscard]] double per_mm(hal::LengthUnit unit);

}  // namespace slabd::simulate
