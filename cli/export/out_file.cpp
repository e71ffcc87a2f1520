// SPDX-License-Identifier: Apache-2.0
#include "cli/export/out_file.h"

#include <cerrno>
#include <cstring>
#include <filesystem>

namespace slabd::cli {

OutFile::OutFile(std::string path) : path_(std::move(path)) {
  if (path_ == "-") {
    file_ = stdout;
    return;
  }
  part_ = path_ + ".part";
  file_ = std::fopen(part_.c_str(), "wb");
  if (file_ == nullptr) error_number_ = errno;
}

OutFile::~OutFile() {
  if (part_.empty() || file_ == nullptr) return;
  std::fclose(file_);
  std::remove(part_.c_str());
}

void OutFile::write(const void* bytes, std::size_t count) {
  if (error_number_ != 0) return;
  if (std::fwrite(bytes, 1, count, file_) != count) error_number_ = errno;
}

void OutFile::write_at_start(std::string_view text) {
  if (error_number_ == 0 && std::fseek(file_, 0, SEEK_SET) != 0) error_number_ = errno;
  write(text);
}

Status OutFile::close() {
  if (part_.empty()) {
    if (error_number_ == 0 && std::fflush(file_) != 0) error_number_ = errno;
  } else if (file_ != nullptr) {
    if (std::fclose(file_) != 0 && error_number_ == 0) error_number_ = errno;
    file_ = nullptr;
    std::error_code trouble;
    if (error_number_ == 0) std::filesystem::rename(part_, path_, trouble);
    if (trouble) error_number_ = trouble.value();
    if (error_number_ != 0) std::remove(part_.c_str());
  }
  if (error_number_ == 0) return success();
  return error(Code::config, "%s cannot be written: %s", path_.c_str(), std::strerror(error_number_));
}

}  // namespace slabd::cli
