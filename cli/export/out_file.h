// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdio>
#include <string>
#include <string_view>

#include "base/result.h"

namespace slabd::cli {

/// A file that appears whole or not at all: written beside its place and renamed. "-" is standard output.
class OutFile {
 public:
  explicit OutFile(std::string path);
  ~OutFile();
  OutFile(const OutFile&) = delete;
  OutFile& operator=(const OutFile&) = delete;

  void write(std::string_view text) { write(text.data(), text.size()); }
  void write(const void* bytes, std::size_t count);
  /// Overwrites what was written first; the rest stays. Not of standard output.
  void write_at_start(std::string_view text);
  /// config: it could not be opened, or not all of it was written; nothing is left then.
  [[nodiscard]] Status close();

 private:
  std::string path_;
  std::string part_;  ///< empty: standard output
  std::FILE* file_ = nullptr;
  int error_number_ = 0;
};

}  // namespace slabd::cli
