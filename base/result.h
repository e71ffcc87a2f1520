// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cassert>
#include <utility>
#include <variant>

#include "base/codes.h"
#include "base/fixed.h"
#include "base/limits.h"

namespace slabd {

/// Why something did not work: the code the PLC and the exit status are derived from, and one sentence for people
/// that names the place (file:line, byte, key or register) and the allowed range.
struct Error {
  Code code = Code::internal;
  FixedString<limits::kErrorTextBytes> text;
};

/// A value or an Error. Check before use; a failed call leaves outputs as they were.
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::move(value)) {}  // NOLINT(google-explicit-constructor)
  Result(const Error& error) : state_(error) {}  // NOLINT(google-explicit-constructor)

  [[nodiscard]] bool ok() const { return std::holds_alternative<T>(state_); }
  explicit operator bool() const { return ok(); }
  [[nodiscard]] T& value() {
    assert(ok());
    return *std::get_if<T>(&state_);
  }
  [[nodiscard]] const T& value() const {
    assert(ok());
    return *std::get_if<T>(&state_);
  }
  [[nodiscard]] const Error& error() const {
    assert(!ok());
    return *std::get_if<Error>(&state_);
  }

 private:
  std::variant<T, Error> state_;
};

struct Nothing {};
using Status = Result<Nothing>;
[[nodiscard]] inline Status success() {
  return Nothing{};
}

/// An Error with a printf-formatted sentence.
[[nodiscard, gnu::format(printf, 2, 3)]] Error error(Code code, const char* format, ...);

}  // namespace slabd
