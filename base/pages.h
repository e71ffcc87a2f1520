// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <type_traits>

#include "base/limits.h"

namespace slabd {

/// One piece of memory for everything that is as large as a scan, held from start to end: in pages of 2 MiB where the
/// system has them (a pass over five million points touches 15 000 pages of 4 KiB, but 30 of these), in ordinary ones
/// where not, and every page written once, so that no scan waits for the kernel to find it a page.
/// Arrays are taken from it one after the other and live as long as it does. Which pages there are changes speed only.
class Pages {
 public:
  /// `bytes`: the sum of limits::array_bytes of the arrays to be taken. Throws std::bad_alloc when there are none.
  explicit Pages(std::size_t bytes);
  ~Pages();
  Pages(const Pages&) = delete;
  Pages& operator=(const Pages&) = delete;

  /// The next `count` items, zeroed, at a multiple of limits::kArrayAlignment. Taking more than the constructor was
  /// told is a broken invariant (the sum in base/limits.h is wrong) and ends the process.
  template <typename T>
  [[nodiscard]] std::span<T> take(std::size_t count) {
    static_assert(std::is_trivially_destructible_v<T>, "nobody ends the life of these items");
    static_assert(alignof(T) <= limits::kArrayAlignment);
    auto* first = static_cast<T*>(take_bytes(limits::array_bytes(count, sizeof(T))));
    std::uninitialized_value_construct_n(first, count);
    return {first, count};
  }

  [[nodiscard]] std::size_t bytes() const { return bytes_; }

 private:
  [[nodiscard]] void* take_bytes(std::size_t bytes);

  std::byte* begin_ = nullptr;
  std::size_t bytes_ = 0;  ///< mapped
  std::size_t limit_ = 0;  ///< that may be taken
  std::size_t taken_ = 0;
};

}  // namespace slabd
