// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>

/// Entry point of every fuzz target. For any input bytes the code returns a value or an error. `script/fuzz` runs a
/// target under libFuzzer with the sanitizers; every build replays the corpus as a test.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace slabd::fuzz {

inline std::string_view text_of(const std::uint8_t* data, std::size_t size) {
  return {static_cast<const char*>(static_cast<const void*>(data)), size};
}

/// Stops if `promise` is false, so that libFuzzer keeps the input. Not assert, because it must work in every build.
inline void must(bool promise, const char* what) {
  if (promise) return;
  std::fprintf(stderr, "broken promise: %s\n", what);
  std::abort();
}

/// A file for decoders that require a path; the same for every input of a process, in memory if possible. Deleted at
/// the end.
class InputFile {
 public:
  explicit InputFile(const char* extension);
  ~InputFile();
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;
  void write(std::string_view bytes) const;
  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] const std::string& folder() const { return folder_; }

 private:
  std::string folder_;
  std::string path_;
};

}  // namespace slabd::fuzz
