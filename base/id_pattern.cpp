// SPDX-License-Identifier: Apache-2.0
#include "base/id_pattern.h"

#include <array>
#include <cassert>
#include <utility>

// Idea: the expression becomes a program of steps, and all ways through it advance together, character by character
// (Thompson, CACM 11, 1968; with groups: Pike's sam). Each step is followed at most once per character, so the time is
// bounded. The list of ways is in order of priority, so the first match is the one that ECMAScript finds.
namespace slabd {

bool IdPattern::Step::takes(char c) const {
  const auto code = static_cast<unsigned char>(c);
  return code < 128 && ((code < 64 ? low : high) >> (code % 64U) & 1U) != 0;
}

// ---- the compiler ------------------------------------------------------------------------------------------------

/// Recursive descent. The code of a part refers only to places in itself and directly behind it, so it can be shifted
/// and copied.
class IdPatternCompiler {
 public:
  explicit IdPatternCompiler(std::string_view text) : text_(text) {}

  Result<IdPattern> compile() {
    if (text_.empty() || text_.size() > IdPattern::kTextBytesMax)
      return error(Code::config, "has %zu characters, allowed are 1..%zu", text_.size(), IdPattern::kTextBytesMax);
    alternatives(0);
    if (!failed_ && at_ < text_.size()) fail("found ) without (");
    Step match;
    match.kind = Kind::match;
    emit(match);
    if (failed_) return error_;
    return pattern_;
  }

 private:
  using Step = IdPattern::Step;
  using Kind = Step::Kind;
  static constexpr int kDepthMax = 16;
  static constexpr int kUnlimited = -1;

  [[nodiscard]] bool more() const { return !failed_ && at_ < text_.size(); }
  [[nodiscard]] char next() const { return text_[at_]; }
  bool skip(char c) {
    if (!more() || next() != c) return false;
    ++at_;
    return true;
  }
  void fail(const char* what) {
    if (failed_) return;
    failed_ = true;
    error_ = error(Code::config, "character %zu: %s", at_ + 1, what);
  }

  // ---- code ----

  [[nodiscard]] std::uint16_t here() const { return static_cast<std::uint16_t>(pattern_.steps_.size()); }
  Step& step(std::size_t index) { return pattern_.steps_[index]; }
  void emit(const Step& new_step) {
    if (!pattern_.steps_.push(new_step)) fail("the expression is too large; repeat or combine less");
  }
  void emit(Kind kind) {
    Step new_step;
    new_step.kind = kind;
    emit(new_step);
  }
  static bool has_next(const Step& s) { return s.kind == Kind::split || s.kind == Kind::jump; }
  static Step shifted(Step s, int by) {
    if (has_next(s)) s.next = static_cast<std::uint16_t>(s.next + by);
    if (s.kind == Kind::split) s.other = static_cast<std::uint16_t>(s.other + by);
    return s;
  }
  /// Makes room for a step in front of the code from `place` on.
  void insert(std::size_t place, Kind kind) {
    emit(kind);
    if (failed_) return;
    for (std::size_t i = pattern_.steps_.size() - 1; i > place; --i) step(i) = shifted(step(i - 1), 1);
    step(place) = {};
    step(place).kind = kind;
  }
  void set_split(std::size_t place, std::uint16_t first, std::uint16_t second, bool lazy) {
    if (failed_) return;
    if (lazy) std::swap(first, second);
    step(place).next = first;
    step(place).other = second;
  }
  /// Appends the code [from, to) again.
  void copy(std::size_t from, std::size_t to) {
    const int by = static_cast<int>(here()) - static_cast<int>(from);
    for (std::size_t i = from; i < to && !failed_; ++i) emit(shifted(step(i), by));
  }
  void emit_jump(std::uint16_t to) {
    Step jump;
    jump.kind = Kind::jump;
    jump.next = to;
    emit(jump);
  }

  // ---- syntax ----

  void alternatives(int depth) {
    const std::uint16_t begin = here();
    sequence(depth);
    if (!skip('|')) return;
    insert(begin, Kind::split);
    const std::uint16_t jump = here();
    emit_jump(0);
    set_split(begin, static_cast<std::uint16_t>(begin + 1), here(), false);
    alternatives(depth);
    if (!failed_) step(jump).next = here();
  }

  void sequence(int depth) {
    while (more() && next() != '|' && next() != ')') {
      const std::uint16_t begin = here();
      const bool repeatable = atom(depth);
      quantifier(begin, repeatable);
    }
  }

  /// True if the atom may be repeated.
  bool atom(int depth) {
    const char c = next();
    switch (c) {
      case '^':
      case '$':
        ++at_;
        emit(c == '^' ? Kind::at_begin : Kind::at_end);
        return false;
      case '(': group(depth); return true;
      case '[': bracket(); return true;
      case '*':
      case '+':
      case '?':
      case '{': fail("found a repetition without anything in front of it; write \\ before a literal one"); return false;
      default: {
        Step one;
        one.kind = Kind::character;
        single(one, true);
        emit(one);
        return true;
      }
    }
  }

  void group(int depth) {
    if (depth == kDepthMax) return fail("found too many ( inside one another, allowed are 16");
    ++at_;
    bool captures = true;
    if (skip('?')) {
      if (!skip(':')) return fail("found (?, allowed is (?: for a group that does not capture");
      captures = false;
    }
    // Only the first group is ever used.
    const bool is_first = captures && ++pattern_.groups_ == 1;
    if (is_first) emit(Kind::group_begin);
    alternatives(depth + 1);
    if (!skip(')')) return fail("the ) of a group is missing");
    if (is_first) emit(Kind::group_end);
  }

  static void add(Step& into, char c) {
    const auto code = static_cast<unsigned char>(c);
    (code < 64 ? into.low : into.high) |= std::uint64_t{1} << (code % 64U);
  }
  static void add(Step& into, char first, char last) {
    for (int c = first; c <= last; ++c) add(into, static_cast<char>(c));
  }
  /// Printable characters that are not in the set.
  static void invert(Step& of) {
    Step other;
    for (char c = 0x20; c < 0x7F; ++c)
      if (!of.takes(c)) add(other, c);
    of.low = other.low;
    of.high = other.high;
  }

  /// One character or a class of characters such as \d. Returns the character if it is a single one.
  std::optional<char> single(Step& into, bool dot_is_any) {
    const char c = next();
    if (c < 0x20 || c >= 0x7F) {
      fail("found a character that is not printable ASCII");
      return std::nullopt;
    }
    ++at_;
    if (c == '.' && dot_is_any) {
      add(into, ' ', '~');
      return std::nullopt;
    }
    if (c != '\\') {
      add(into, c);
      return c;
    }
    if (!more()) {
      fail("found \\ at the end");
      return std::nullopt;
    }
    const char escaped = next();
    Step known;
    switch (escaped) {
      case 'd':
      case 'D': add(known, '0', '9'); break;
      case 'w':
      case 'W':
        add(known, '0', '9');
        add(known, 'A', 'Z');
        add(known, 'a', 'z');
        add(known, '_');
        break;
      case 's':
      case 'S': add(known, ' '); break;
      default: {
        const bool letter_or_digit = (escaped >= '0' && escaped <= '9') || (escaped >= 'a' && escaped <= 'z') ||
                                     (escaped >= 'A' && escaped <= 'Z');
        if (letter_or_digit || escaped < 0x20 || escaped >= 0x7F) {
          fail("allowed after \\ are d, D, w, W, s, S and punctuation");
          return std::nullopt;
        }
        ++at_;
        add(into, escaped);
        return escaped;
      }
    }
    ++at_;
    if (escaped < 'a') invert(known);
    into.low |= known.low;
    into.high |= known.high;
    return std::nullopt;
  }

  /// [abc], [^a-z\d]
  void bracket() {
    ++at_;
    Step found;
    found.kind = Kind::character;
    const bool inverted = skip('^');
    if (more() && next() == ']') return fail("found an empty [], allowed is at least one character");
    while (more() && next() != ']') {
      if (next() == '[' && at_ + 1 < text_.size() &&
          (text_[at_ + 1] == ':' || text_[at_ + 1] == '.' || text_[at_ + 1] == '='))
        return fail("found a named class such as [:digit:], allowed are ranges such as 0-9 and \\d");
      const std::optional<char> first = single(found, false);
      const bool range = more() && next() == '-' && at_ + 1 < text_.size() && text_[at_ + 1] != ']';
      if (!range) continue;
      ++at_;
      Step ignored;
      const std::optional<char> last = single(ignored, false);
      if (failed_) return;
      if (!first || !last || *last < *first) return fail("found a range in the wrong order, or of a class");
      add(found, *first, *last);
    }
    if (!skip(']')) return fail("the ] of a set is missing");
    if (inverted) invert(found);
    emit(found);
  }

  /// A number of {m,n}.
  std::optional<int> number() {
    int value = 0;
    bool any = false;
    while (more() && next() >= '0' && next() <= '9' && value <= IdPattern::kRepeatsMax) {
      value = 10 * value + (next() - '0');
      any = true;
      ++at_;
    }
    if (value > IdPattern::kRepeatsMax) fail("found a larger number of repetitions than 32");
    return any ? std::optional(value) : std::nullopt;
  }

  void quantifier(std::size_t begin, bool repeatable) {
    if (!more()) return;
    int least = 0;
    int most = kUnlimited;
    switch (next()) {
      case '*': ++at_; break;
      case '+':
        ++at_;
        least = 1;
        break;
      case '?':
        ++at_;
        most = 1;
        break;
      case '{': {
        ++at_;
        const std::optional<int> low = number();
        if (!low) return fail("allowed in { } are {m}, {m,} and {m,n}");
        least = *low;
        most = least;
        if (skip(',')) most = number().value_or(kUnlimited);
        if (!skip('}')) return fail("allowed in { } are {m}, {m,} and {m,n}");
        if (most != kUnlimited && most < least) return fail("found {m,n} with n smaller than m");
        break;
      }
      default: return;
    }
    if (!repeatable) return fail("^ and $ cannot be repeated");
    const bool lazy = skip('?');
    if (more() && (next() == '*' || next() == '+' || next() == '?' || next() == '{'))
      return fail("found a repetition of a repetition; put the first one in (?: )");
    repeat(begin, least, most, lazy);
  }

  /// Replaces the code from `begin` on by its repetition.
  void repeat(std::size_t begin, int least, int most, bool lazy) {
    const std::size_t size = here() - begin;
    if (most == 0) {
      // Matches the empty text only: the code is jumped over.
      insert(begin, Kind::jump);
      if (!failed_) step(begin).next = here();
      return;
    }
    for (int i = 1; i < least && !failed_; ++i) copy(begin, begin + size);
    if (most == kUnlimited) {
      std::size_t loop = begin;
      if (least > 0) {
        loop = here();
        copy(begin, begin + size);
      }
      insert(loop, Kind::split);
      emit_jump(static_cast<std::uint16_t>(loop));
      set_split(loop, static_cast<std::uint16_t>(loop + 1), here(), lazy);
      return;
    }
    // The optional copies: each begins with a split whose other way leads behind all of them.
    std::size_t source = begin;
    FixedVector<std::uint16_t, IdPattern::kRepeatsMax> splits;
    for (int i = least; i < most && !failed_; ++i) {
      std::size_t place = here();
      if (i == 0) {
        place = begin;
        insert(place, Kind::split);
        source = begin + 1;
      } else {
        emit(Kind::split);
        copy(source, source + size);
      }
      const bool room = splits.push(static_cast<std::uint16_t>(place));
      assert(room);
      static_cast<void>(room);
    }
    for (const std::uint16_t split : splits) set_split(split, static_cast<std::uint16_t>(split + 1), here(), lazy);
  }

  std::string_view text_;
  std::size_t at_ = 0;
  bool failed_ = false;
  Error error_;
  IdPattern pattern_;
};

Result<IdPattern> IdPattern::compile(std::string_view expression) {
  return IdPatternCompiler(expression).compile();
}

// ---- matching ----------------------------------------------------------------------------------------------------

/// The ways at one place of the text, in order of priority.
class IdPattern::Threads {
 public:
  struct Thread {
    std::uint16_t step = 0;
    Group group;
  };
  void clear() {
    threads_.clear();
    seen_.fill(false);
  }
  [[nodiscard]] const FixedVector<Thread, kStepsMax>& list() const { return threads_; }

  /// Follows the steps from `first` on that take no character.
  void follow(const FixedVector<Step, kStepsMax>& steps, std::size_t first, Group group, std::size_t at,
              std::size_t size) {
    open_.clear();
    put(first, group);
    while (!open_.empty()) {
      Thread now = open_.back();
      open_.erase(open_.size() - 1);
      if (seen_[now.step]) continue;
      seen_[now.step] = true;
      const Step& step = steps[now.step];
      switch (step.kind) {
        case Step::Kind::split:
          put(step.other, now.group);  // waits until everything behind the first way was followed
          put(step.next, now.group);
          break;
        case Step::Kind::jump: put(step.next, now.group); break;
        case Step::Kind::group_begin:
          now.group = {static_cast<std::uint8_t>(at), Group::kNone};
          put(now.step + 1U, now.group);
          break;
        case Step::Kind::group_end:
          now.group.end = static_cast<std::uint8_t>(at);
          put(now.step + 1U, now.group);
          break;
        case Step::Kind::at_begin:
          if (at == 0) put(now.step + 1U, now.group);
          break;
        case Step::Kind::at_end:
          if (at == size) put(now.step + 1U, now.group);
          break;
        case Step::Kind::character:
        case Step::Kind::match: push(threads_, now); break;
      }
    }
  }

 private:
  template <typename List>
  static void push(List& list, const Thread& thread) {
    const bool room = list.push(thread);
    assert(room);
    static_cast<void>(room);
  }
  void put(std::size_t step, const Group& group) { push(open_, {static_cast<std::uint16_t>(step), group}); }

  FixedVector<Thread, kStepsMax> threads_;
  FixedVector<Thread, 2 * kStepsMax + 1> open_;  // each step is followed once and puts at most two
  std::array<bool, kStepsMax> seen_{};
};

std::optional<IdPattern::Group> IdPattern::run(std::string_view text, bool whole) const {
  if (text.size() >= Group::kNone || steps_.empty()) return std::nullopt;
  Threads now;
  Threads next;
  std::optional<Group> found;
  for (std::size_t at = 0; at <= text.size(); ++at) {
    // A search begins at every place until something matches; an earlier beginning has priority.
    if (at == 0 || (!whole && !found)) now.follow(steps_, 0, {}, at, text.size());
    next.clear();
    for (const Threads::Thread& thread : now.list()) {
      const Step& step = steps_[thread.step];
      if (step.kind == Step::Kind::match) {
        if (whole && at < text.size()) continue;
        found = thread.group;
        break;  // the ways after it have less priority
      }
      if (at < text.size() && step.takes(text[at]))
        next.follow(steps_, thread.step + 1U, thread.group, at + 1, text.size());
    }
    std::swap(now, next);
    if (now.list().empty() && (whole || found)) break;
  }
  return found;
}

bool IdPattern::matches(std::string_view text) const {
  return run(text, true).has_value();
}

std::optional<std::string_view> IdPattern::first_group(std::string_view text) const {
  const std::optional<Group> group = run(text, false);
  if (!group || group->begin == Group::kNone || group->end == Group::kNone) return std::nullopt;
  return text.substr(group->begin, static_cast<std::size_t>(group->end - group->begin));
}

}  // namespace slabd
