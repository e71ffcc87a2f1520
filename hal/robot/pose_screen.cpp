// SPDX-License-Identifier: Apache-2.0
#include "hal/robot/pose_screen.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdarg>
#include <utility>

// Problem: a well-formed pose may still be wrong. A second program may publish too, a network may deliver an old
// datagram late, a sender's memory may be torn for one cycle. Idea: accept one publisher at a time, whose clock runs
// forward and whose arm moves at plausible speed. Invariants: no pose is accepted while two publish. This class refuses
// poses because of its history for at most kSilent_ns; otherwise a sender's clock that was set would block the link.
namespace slabd::hal {
namespace {

constexpr std::int64_t kRefusalShown_ns = 2 * kNsPerS;

FixedString<24> text_of(const PosePublisher& p) {
  FixedString<24> text;
  text.printf("%u.%u.%u.%u:%u", p.address >> 24U, (p.address >> 16U) & 255U, (p.address >> 8U) & 255U, p.address & 255U,
              unsigned{p.port});
  return text;
}

/// Time between two messages by the sender's clock; unsigned, because the numbers may have any value.
std::uint64_t forward_us(const PoseSample& from, const PoseSample& to) {
  return static_cast<std::uint64_t>(to.utime_us) - static_cast<std::uint64_t>(from.utime_us);
}
std::uint64_t forward_us_from(std::int64_t utime_us, const PoseSample& to) {
  return static_cast<std::uint64_t>(to.utime_us) - static_cast<std::uint64_t>(utime_us);
}
bool runs_forward(const PoseSample& from, const PoseSample& to) {
  const std::uint64_t step = forward_us(from, to);
  return step != 0 && step < std::uint64_t{1} << 63U;
}

bool is_jump(const PoseSample& from, const PoseSample& to) {
  constexpr double kLongestS = 1.0;  // after this time the arm may be anywhere
  const double dt_s = std::min(static_cast<double>(forward_us(from, to)) / 1e6, kLongestS);
  const double step_mm = (to.T_base_flange.translation_mm - from.T_base_flange.translation_mm).norm();
  const double step_rad = angle_between_rad(from.T_base_flange.rotation, to.T_base_flange.rotation);
  return step_mm > PoseScreen::kStep_mm + PoseScreen::kSpeedMmPerS * dt_s ||
         step_rad > PoseScreen::kStep_rad + PoseScreen::kSpeedRadPerS * dt_s;
}

}  // namespace

void PoseScreen::refuse(const PosePublisher& from, std::int64_t mono_ns, const char* format, ...) {
  va_list args;
  va_start(args, format);
  std::array<char, 224> bytes{};
  std::vsnprintf(bytes.data(), bytes.size(), format, args);
  va_end(args);
  refusal_.printf("%s from %s", bytes.data(), text_of(from).c_str());
  refused_ns_ = mono_ns;
}

void PoseScreen::note_sender(const PosePublisher& from, std::int64_t mono_ns, const char* why) {
  refuse(from, mono_ns, "%s", why);
}

void PoseScreen::check_clock(std::int64_t mono_ns, const PoseSample& sample) {
  constexpr std::int64_t kSpan_ns = kNsPerS / 2;
  constexpr int kSamplesMin = 10;
  // Arrivals come in bursts and clocks are set; a wrong unit is repeatedly a factor of a thousand.
  constexpr double kThousandLow = 300.0;
  constexpr double kThousandHigh = 3'000.0;
  if (clock_from_ns_ != 0 && mono_ns - clock_from_ns_ < kSpan_ns) {
    ++clock_samples_;
    return;
  }
  if (clock_from_ns_ != 0 && clock_samples_ >= kSamplesMin) {
    const double arrived_us = static_cast<double>(mono_ns - clock_from_ns_) / 1e3;
    const double sent_us =
        static_cast<double>(static_cast<std::uint64_t>(sample.utime_us) - static_cast<std::uint64_t>(clock_from_us_));
    const double rate = sent_us / arrived_us;
    const bool fast = rate > kThousandLow && rate < kThousandHigh;
    const bool slow = rate > 1.0 / kThousandHigh && rate < 1.0 / kThousandLow;
    clock_odd_ = fast || slow ? clock_odd_ + 1 : 0;
    clock_unit_ = clock_odd_ < 2 ? nullptr : fast ? "nanoseconds" : "milliseconds";
  }
  clock_from_ns_ = mono_ns;
  clock_from_us_ = sample.utime_us;
  clock_samples_ = 0;
}

void PoseScreen::check_seconds(std::int64_t mono_ns, const PoseSample& sample) {
  constexpr std::int64_t kSpan_ns = 3 * kNsPerS;
  constexpr int kSamplesMin = 30;
  const std::uint64_t steps = forward_us_from(seconds_from_us_, sample);
  const bool started = seconds_from_ns_ != 0;
  ++seconds_samples_;
  // A clock in microseconds or milliseconds leaves this range with its first messages.
  const bool may_be_seconds = started && steps <= 4;
  if (started && may_be_seconds && mono_ns - seconds_from_ns_ < kSpan_ns) return;
  in_seconds_ = may_be_seconds && steps >= 2 && seconds_samples_ >= kSamplesMin;
  seconds_from_ns_ = mono_ns;
  seconds_from_us_ = sample.utime_us;
  seconds_samples_ = 0;
}

void PoseScreen::follow_sockets(const PosePublisher& from, std::int64_t mono_ns, const PoseSample& sample) {
  constexpr std::int64_t kOfOneSender_ns = 10 * kNsPerS;  // a restarted bridge comes less often
  const bool of_same_computer = heard_.ever && heard_.who.address == from.address;
  if (!of_same_computer) {
    recent_ports_ = {};
    strangers_ = continued_ = 0;
    on_socket_ = on_socket_before_ = 0;
  } else if (heard_.who.port != from.port) {
    const bool known = std::find(recent_ports_.begin(), recent_ports_.end(), from.port) != recent_ports_.end();
    const bool in_a_row = strangers_ == 0 || mono_ns - stranger_ns_ < kOfOneSender_ns;
    strangers_ = known ? 0 : in_a_row ? strangers_ + 1 : 1;
    if (!known) stranger_ns_ = mono_ns;
    const std::uint32_t step = static_cast<std::uint32_t>(sample.seq) - static_cast<std::uint32_t>(heard_seq_);
    continued_ = sample.seq != 0 && step == 1U ? continued_ + 1 : 0;
    on_socket_before_ = std::exchange(on_socket_, 0);
  }
  if (!of_same_computer || heard_.who.port != from.port) {
    recent_ports_[next_port_] = from.port;
    next_port_ = (next_port_ + 1) % recent_ports_.size();
  }
  ++on_socket_;
  heard_ = {from, mono_ns, true};
  heard_seq_ = sample.seq;
}

bool PoseScreen::is_alone(const PosePublisher& from, std::int64_t mono_ns, PoseLinkCounters& counters) {
  if (owner_.ever && !(owner_.who == from) && owner_.within(mono_ns, kSilent_ns)) {
    // A second publisher, or the owner's successor: the owner's next pose or its silence decides. Two newcomers count
    // as two.
    const bool two_newcomers = !(rival_.who == from) && rival_.within(mono_ns, kSilent_ns);
    rival_ = {from, mono_ns, true};
    ++since_owner_;
    if (two_newcomers) settle_rivals(counters);
    return false;
  }
  if (owner_.ever && owner_.who == from) {
    settle_rivals(counters);
  } else {
    // Another program, with its own clock and numbers.
    has_last_ = has_pending_ = has_seq_ = false;
    clock_from_ns_ = 0;
    clock_odd_ = 0;
    clock_unit_ = nullptr;
    seconds_from_ns_ = 0;
    seconds_samples_ = 0;
    in_seconds_ = false;
    if (rival_.who == from) rival_.ever = false;
    if (owner_.ever) ++changes_;
    waited_ += since_owner_;
    since_owner_ = 0;
  }
  owner_ = {from, mono_ns, true};
  if (!rival_.within(mono_ns, kSilent_ns)) return true;
  ++counters.second_publisher;
  return false;
}

void PoseScreen::refuse_rival(const PosePublisher& from, std::int64_t mono_ns) {
  const PosePublisher& other = owner_.who == from ? rival_.who : owner_.who;
  // Two programs each return with numbers of their own.
  constexpr int kInARow = 5;
  if (strangers_ >= kInARow)
    refuse(from, mono_ns,
           "the sender opens a new socket %s, so slabd cannot distinguish it from a second program (create the LCM "
           "object once): %s, and now one",
           on_socket_before_ == 1 ? "for each message" : "every few messages", text_of(other).c_str());
  else if (continued_ >= kInARow)
    refuse(from, mono_ns,
           "the sender uses several sockets in turn, so slabd cannot distinguish it from a second program (create one "
           "LCM object): %s, and now one",
           text_of(other).c_str());
  else
    refuse(from, mono_ns, "two programs publish poses, so neither is used: %s, and another", text_of(other).c_str());
}

void PoseScreen::settle_rivals(PoseLinkCounters& counters) {
  counters.second_publisher += since_owner_;
  since_owner_ = 0;
}

void PoseScreen::count_numbering(const PoseSample& sample, PoseLinkCounters& counters) {
  const bool counts = sample.seq != 0 || (has_seq_ && seq_ != 0);
  const std::uint32_t step = static_cast<std::uint32_t>(sample.seq) - static_cast<std::uint32_t>(seq_);
  if (has_seq_ && counts && step != 1U) {
    ++counters.gaps;
    // A backward step: the sender restarted, and the number of missing messages is unknown.
    if (step != 0U && step < 1U << 31U) counters.lost += step - 1U;
  }
  has_seq_ = true;
  seq_ = sample.seq;
}

bool PoseScreen::admit(const PosePublisher& from, std::int64_t mono_ns, const PoseSample& sample,
                       PoseLinkCounters& counters) {
  follow_sockets(from, mono_ns, sample);
  if (!is_alone(from, mono_ns, counters)) {
    refuse_rival(from, mono_ns);
    return false;
  }
  check_seconds(mono_ns, sample);
  if (has_last_ && mono_ns - last_ns_ >= kSilent_ns) has_last_ = has_pending_ = has_seq_ = false;
  if (has_last_ && !in_seconds_ && !runs_forward(last_, sample)) {
    if (sample.utime_us == last_.utime_us && sample.seq == last_.seq) {
      ++counters.repeated;
      refuse(from, mono_ns, "the same message again (number %d)", sample.seq);
    } else {
      ++counters.time_back;
      refuse(from, mono_ns, "the sender's clock does not run forward (%.3f s, number %d)",
             static_cast<double>(static_cast<std::int64_t>(forward_us(last_, sample))) / 1e6, sample.seq);
    }
    return false;
  }
  count_numbering(sample, counters);
  check_clock(mono_ns, sample);
  if (const char* unit = in_seconds_ ? "seconds" : clock_unit_; unit != nullptr) {
    ++counters.time_unit;
    refuse(from, mono_ns, "poses whose utime counts in %s and not in microseconds, so that no jump could be seen,",
           unit);
    has_last_ = has_pending_ = false;
    return false;
  }
  if (has_last_ && is_jump(last_, sample)) {
    const bool confirmed = has_pending_ && runs_forward(pending_, sample) && !is_jump(pending_, sample);
    if (!confirmed) {
      ++counters.jumps;
      refuse(from, mono_ns, "a jump of %.1f mm and %.3f deg within %.1f ms",
             (sample.T_base_flange.translation_mm - last_.T_base_flange.translation_mm).norm(),
             deg_from_rad(angle_between_rad(last_.T_base_flange.rotation, sample.T_base_flange.rotation)),
             static_cast<double>(forward_us(last_, sample)) / 1e3);
      has_pending_ = true;
      pending_ = sample;
      return false;
    }
  }
  has_pending_ = false;
  has_last_ = true;
  last_ = sample;
  last_ns_ = mono_ns;
  return true;
}

std::string_view PoseScreen::refusal(std::int64_t mono_ns) const {
  if (refusal_.empty() || mono_ns - refused_ns_ > kRefusalShown_ns) return {};
  return refusal_.view();
}

bool PoseScreen::next_note(std::int64_t mono_ns, const PoseLinkCounters& now, PoseNoteText& text) {
  struct Trouble {
    std::uint64_t count;
    const char* what;
  };
  const std::array troubles = {
      Trouble{now.second_publisher - said_.second_publisher, "poses while two programs publish"},
      Trouble{now.wrong_sender - said_.wrong_sender, "datagrams from senders that may not publish"},
      Trouble{now.other_type - said_.other_type, "messages of another type on this channel"},
      Trouble{now.not_finite - said_.not_finite, "poses that are not finite"},
      Trouble{now.not_unit - said_.not_unit, "quaternions that are not of unit length"},
      Trouble{now.out_of_reach - said_.out_of_reach, "poses out of reach"},
      Trouble{now.time_back - said_.time_back, "poses by a clock that does not run forward"},
      Trouble{now.time_unit - said_.time_unit, "poses whose utime is not in microseconds"},
      Trouble{now.repeated - said_.repeated, "repeated"},
      Trouble{now.jumps - said_.jumps, "jumps"},
      Trouble{now.lost - said_.lost, "lost"},
  };
  bool any = now.gaps != said_.gaps || changes_ != 0;
  for (const Trouble& trouble : troubles) any = any || trouble.count != 0;
  if (!any || !note_limit_.permits(mono_ns)) return false;
  text.printf("robot pose: %llu breaks in the numbering", static_cast<unsigned long long>(now.gaps - said_.gaps));
  said_ = now;
  for (const Trouble& trouble : troubles) {
    if (trouble.count == 0) continue;
    FixedString<96> part;
    part.printf(", %llu %s", static_cast<unsigned long long>(trouble.count), trouble.what);
    text.append(part.view());
  }
  if (changes_ != 0) {
    FixedString<96> part;
    part.printf(", %llu times another sender (%llu of its poses waited for the old one's silence)",
                static_cast<unsigned long long>(changes_), static_cast<unsigned long long>(waited_));
    text.append(part.view());
    changes_ = waited_ = 0;
  }
  if (const std::string_view last = refusal(mono_ns); !last.empty()) {
    text.append("; last: ");
    text.append(last);
  }
  return true;
}

}  // namespace slabd::hal
