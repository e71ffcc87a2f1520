// SPDX-License-Identifier: Apache-2.0
//
// Whoever stops a long export (Ctrl-C, a time limit) finds nothing half done: neither under the file's name, nor the
// hundreds of megabytes beside it.
#include "cli/export/out_file.h"

#include <signal.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>

namespace slabd::cli {
namespace {

/// What is being written, for the handler; empty: nothing. One file at a time.
std::array<char, 4096> under_way{};

constexpr std::array kStops = {SIGINT, SIGTERM, SIGHUP};

void stopped(int number) {
  if (under_way[0] != '\0') ::unlink(under_way.data());
  // The handler was for once: now the signal does what it does.
  ::raise(number);
}

void note_under_way(const std::string& part) {
  if (part.size() >= under_way.size()) return;
  std::memcpy(under_way.data(), part.c_str(), part.size() + 1);
  for (const int number : kStops) {
    struct sigaction now {};
    // One that is ignored (nohup) stays ignored.
    if (::sigaction(number, nullptr, &now) != 0 || now.sa_handler != SIG_DFL) continue;
    struct sigaction once {};
    once.sa_handler = stopped;
    once.sa_flags = static_cast<int>(SA_RESETHAND);
    ::sigaction(number, &once, nullptr);
  }
}

}  // namespace

OutFile::OutFile(std::string path) : path_(std::move(path)) {
  if (path_ == "-") {
    file_ = stdout;
    return;
  }
  part_ = path_ + ".part";
  file_ = std::fopen(part_.c_str(), "wb");
  if (file_ == nullptr)
    error_number_ = errno;
  else
    note_under_way(part_);
}

OutFile::~OutFile() {
  if (part_.empty() || file_ == nullptr) return;
  std::fclose(file_);
  std::remove(part_.c_str());
  under_way[0] = '\0';
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
    under_way[0] = '\0';
  }
  if (error_number_ == 0) return success();
  return error(Code::config, "%s cannot be written: %s", path_.c_str(), std::strerror(error_number_));
}

}  // namespace slabd::cli
