// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "tests/fuzz/fuzz.h"

namespace slabd::fuzz {

InputFile::InputFile(const char* extension) {
  folder_ =
      (access("/dev/shm", W_OK) == 0 ? std::string("/dev/shm") : std::filesystem::temp_directory_path().string()) +
      "/slabd-fuzz-XXXXXX";
  if (mkdtemp(folder_.data()) == nullptr) std::abort();
  path_ = folder_ + "/input" + extension;
}

InputFile::~InputFile() {
  std::error_code ec;
  std::filesystem::remove_all(folder_, ec);
}

void InputFile::write(std::string_view bytes) const {
  std::ofstream out(path_, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

}  // namespace slabd::fuzz
