// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cassert>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string_view>

/// Containers of fixed capacity: no heap, trivially copyable if their elements are. A full container is reported by a
/// return value, not by an exception.
namespace slabd {

/// Text of at most `Capacity` bytes, for people and identifiers. Longer text is truncated, never rejected.
template <std::size_t Capacity>
class FixedString {
 public:
  constexpr FixedString() = default;
  constexpr FixedString(std::string_view text) { assign(text); }  // NOLINT(google-explicit-constructor)
  constexpr FixedString(const char* text) { assign(text); }       // NOLINT(google-explicit-constructor)

  constexpr void assign(std::string_view text) {
    size_ = 0;
    append(text);
  }
  constexpr void append(std::string_view text) {
    for (const char c : text) {
      if (size_ == Capacity) break;
      bytes_[size_++] = c;
    }
    bytes_[size_] = '\0';
  }
  /// printf into the string; `%s` must be given a NUL-terminated argument.
  [[gnu::format(printf, 2, 3)]] void printf(const char* format, ...) {
    va_list args;
    va_start(args, format);
    const int n = std::vsnprintf(bytes_.data(), bytes_.size(), format, args);
    va_end(args);
    size_ = n < 0 ? 0 : (static_cast<std::size_t>(n) > Capacity ? Capacity : static_cast<std::size_t>(n));
    bytes_[size_] = '\0';
  }
  constexpr void clear() { assign({}); }

  [[nodiscard]] constexpr std::string_view view() const { return {bytes_.data(), size_}; }
  [[nodiscard]] constexpr const char* c_str() const { return bytes_.data(); }
  [[nodiscard]] constexpr std::size_t size() const { return size_; }
  [[nodiscard]] constexpr bool empty() const { return size_ == 0; }
  [[nodiscard]] static constexpr std::size_t capacity() { return Capacity; }

  friend constexpr bool operator==(const FixedString& a, const FixedString& b) { return a.view() == b.view(); }
  friend constexpr bool operator==(const FixedString& a, std::string_view b) { return a.view() == b; }

 private:
  std::array<char, Capacity + 1> bytes_{};
  std::size_t size_ = 0;
};

/// A vector of at most `Capacity` elements. `push` returns false if it is full.
template <typename T, std::size_t Capacity>
class FixedVector {
 public:
  [[nodiscard]] constexpr bool push(const T& value) {
    if (size_ == Capacity) return false;
    items_[size_++] = value;
    return true;
  }
  constexpr void clear() { size_ = 0; }
  constexpr void erase(std::size_t index) {
    assert(index < size_);
    for (std::size_t i = index + 1; i < size_; ++i) items_[i - 1] = items_[i];
    --size_;
  }

  [[nodiscard]] constexpr std::size_t size() const { return size_; }
  [[nodiscard]] constexpr bool empty() const { return size_ == 0; }
  [[nodiscard]] constexpr bool full() const { return size_ == Capacity; }
  [[nodiscard]] static constexpr std::size_t capacity() { return Capacity; }
  [[nodiscard]] constexpr T& operator[](std::size_t index) {
    assert(index < size_);
    return items_[index];
  }
  [[nodiscard]] constexpr const T& operator[](std::size_t index) const {
    assert(index < size_);
    return items_[index];
  }
  [[nodiscard]] constexpr T& back() { return (*this)[size_ - 1]; }
  [[nodiscard]] constexpr const T& back() const { return (*this)[size_ - 1]; }
  [[nodiscard]] constexpr T* data() { return items_.data(); }
  [[nodiscard]] constexpr const T* data() const { return items_.data(); }
  [[nodiscard]] constexpr T* begin() { return items_.data(); }
  [[nodiscard]] constexpr T* end() { return items_.data() + size_; }
  [[nodiscard]] constexpr const T* begin() const { return items_.data(); }
  [[nodiscard]] constexpr const T* end() const { return items_.data() + size_; }

 private:
  std::array<T, Capacity> items_{};
  std::size_t size_ = 0;
};

/// First in, first out, at most `Capacity` elements.
template <typename T, std::size_t Capacity>
class FixedQueue {
 public:
  [[nodiscard]] constexpr bool push(const T& value) {
    if (size_ == Capacity) return false;
    items_[(head_ + size_) % Capacity] = value;
    ++size_;
    return true;
  }
  [[nodiscard]] constexpr bool empty() const { return size_ == 0; }
  [[nodiscard]] constexpr bool full() const { return size_ == Capacity; }
  [[nodiscard]] constexpr std::size_t size() const { return size_; }
  [[nodiscard]] constexpr const T& front() const {
    assert(size_ > 0);
    return items_[head_];
  }
  /// The i-th oldest element.
  [[nodiscard]] constexpr const T& operator[](std::size_t index) const {
    assert(index < size_);
    return items_[(head_ + index) % Capacity];
  }
  constexpr void pop() {
    assert(size_ > 0);
    head_ = (head_ + 1) % Capacity;
    --size_;
  }
  constexpr void clear() { head_ = size_ = 0; }

 private:
  std::array<T, Capacity> items_{};
  std::size_t head_ = 0;
  std::size_t size_ = 0;
};

}  // namespace slabd
