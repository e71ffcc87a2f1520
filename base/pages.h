// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <type_traits>

#include "base/limits.h"

namespace slabd {

/// One memory mapping for all data as large as a scan, held from start to end. It uses pages of 2 MiB if available,
/// else ordinary ones. A pass over five million points touches 15 000 pages of 4 KiB, but only 30 of 2 MiB. Every page
/// is written once, so that no scan waits for a page fault. Arrays are taken from it in sequence and live as long as it
/// does. The page size affects only speed.
class Pages {
 public:
  /// `bytes`: the sum of limits::array_bytes of all arrays to be taken. Throws std::bad_alloc if the mapping fails.
  explicit Pages(std::size_t bytes);
  ~Pages();
  Pages(const Pages&) = delete;
  Pages& operator=(const Pages&) = delete;

  /// Returns the next `count` items, zeroed, at a multiple of limits::kArrayAlignment. Taking more than the
  /// constructor's `bytes` is a broken invariant (the sum in base/limits.h is wrong) and ends the process.
  template <typename T>
  [[nodiscard]] std::span<T> take(std::size_t count) {
    static_assert(std::is_trivially_destructible_v<T>, "the destructors of these items are never called");
    static_assert(alignof(T) <= limits::kArrayAlignment);
    auto* first = static_cast<T*>(take_bytes(limits::array_bytes(count, sizeof(T))));
    std::uninitialized_value_construct_n(first, count);
    return {first, count};
  }

  [[nodiscard]] std::size_t bytes() const { return bytes_; }

 private:
  [[nodiscard]] void* take_bytes(std::size_t bytes);

  std::byte* begin_ = nullptr;
  std::size_t bytes_ = 0;  ///< mapped bytes
  std::size_t limit_ = 0;  ///< bytes that may be taken
  std::size_t taken_ = 0;
};

}  // namespace slabd
