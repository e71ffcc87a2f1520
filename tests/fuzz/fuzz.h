// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>

/// What every fuzz target is: bytes from outside go in; whatever they are, nothing but a value or an error may come
/// out. `script/fuzz` runs a target under libFuzzer with the sanitizers; every build replays the corpus as a test.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace slabd::fuzz {

inline std::string_view text_of(const std::uint8_t* data, std::size_t size) {
  return {static_cast<const char*>(static_cast<const void*>(data)), size};
}

/// A promise of the decoder was broken; stops, so that the input is kept. Not assert: it holds in every build.
inline void must(bool promise, const char* what) {
  if (promise) return;
  std::fprintf(stderr, "broken promise: %s\n", what);
  std::abort();
}

/// A file of its own for decoders that want a path; the same for every input of a process, in memory where there is
/// some. Deleted at the end.
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
