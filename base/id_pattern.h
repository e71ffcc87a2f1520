// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "base/fixed.h"
#include "base/result.h"

namespace slabd {

/// Regular expression for ids of slabs: printable ASCII with the syntax of ECMAScript, without back references, word
/// boundaries and lookahead. Matching takes no heap, and its time is at most proportional to the length of the text
/// times the number of steps, whatever the expression. (std::regex takes exponential time for (a+)+b, and the loop that
/// answers the PLC would stop for minutes.)
class IdPattern {
 public:
  static constexpr std::size_t kTextBytesMax = 128;  ///< longest expression
  static constexpr std::size_t kStepsMax = 256;      ///< a SLAB_ID has 32 characters, each a step of its own
  static constexpr int kRepeatsMax = 32;             ///< largest number in {m,n}

  /// config: the text contains the place of the fault in the expression and what is allowed.
  [[nodiscard]] static Result<IdPattern> compile(std::string_view expression);

  /// Number of groups that capture.
  [[nodiscard]] int groups() const { return groups_; }
  /// True if the whole text matches. False for a text of more than 254 characters.
  [[nodiscard]] bool matches(std::string_view text) const;
  /// Text of the first group in the first match anywhere in `text`, a view of it. nullopt if nothing matches, or if the
  /// group is not a part of the match.
  [[nodiscard]] std::optional<std::string_view> first_group(std::string_view text) const;

 private:
  friend class IdPatternCompiler;
  struct Step {
    enum class Kind : std::uint8_t {
      character,  ///< takes a character of `set`
      split,      ///< continues at `next`, and with less priority at `other`
      jump,       ///< continues at `next`
      group_begin,
      group_end,
      at_begin,
      at_end,
      match
    };
    Kind kind = Kind::match;
    std::uint16_t next = 0;
    std::uint16_t other = 0;
    std::uint64_t low = 0;   ///< set: characters 0..63, ...
    std::uint64_t high = 0;  ///< ... 64..127

    [[nodiscard]] bool takes(char c) const;
  };
  struct Group {
    static constexpr std::uint8_t kNone = 0xFF;
    std::uint8_t begin = kNone;
    std::uint8_t end = kNone;
  };
  class Threads;

  [[nodiscard]] std::optional<Group> run(std::string_view text, bool whole) const;

  FixedVector<Step, kStepsMax> steps_;
  int groups_ = 0;
};

}  // namespace slabd
