// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <unistd.h>

#include <cstring>
#include <utility>

/// The two things every file of this room needs from the operating system.
namespace slabd::hal {

/// What errno means, as a constant text (no heap, thread-safe).
[[nodiscard]] inline const char* errno_text(int error_number) {
  const char* text = strerrordesc_np(error_number);
  return text == nullptr ? "unknown error" : text;
}

/// Owns one file descriptor; -1 = none. Closing errors are ignored: what must be durable is synced before.
class Fd {
 public:
  Fd() = default;
  explicit Fd(int fd) : fd_(fd) {}
  ~Fd() { reset(); }
  Fd(const Fd&) = delete;
  Fd& operator=(const Fd&) = delete;
  Fd(Fd&& other) noexcept : fd_(other.release()) {}
  Fd& operator=(Fd&& other) noexcept {
    if (this != &other) {
      reset();
      fd_ = other.release();
    }
    return *this;
  }

  [[nodiscard]] int get() const { return fd_; }
  [[nodiscard]] bool is_open() const { return fd_ >= 0; }
  [[nodiscard]] int release() { return std::exchange(fd_, -1); }
  void reset() {
    if (fd_ >= 0) close(fd_);
    fd_ = -1;
  }

 private:
  int fd_ = -1;
};

}  // namespace slabd::hal
