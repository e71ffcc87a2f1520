// SPDX-License-Identifier: Apache-2.0
//
// Searches all states breadth first, so that the path to a violation is the shortest one. A step cannot be interrupted:
// a message arrives, a record becomes durable, a scan is taken, the PLC runs one cycle, a process dies. Every possible
// next step is tried.
#include "tests/daemon/station/handshake_model.h"

#include <fmt/core.h>

#include <algorithm>
#include <cstring>
#include <string_view>
#include <unordered_map>
#include <utility>

namespace slabd::handshake {

// ---- slabd ---------------------------------------------------------------------------------------------------------

void Slabd::receive(const Frame& frame, const Rules& rules) {
  if (!up) return;
  if (frame.seq == judged.seq && frame.session == judged.session && frame.writer == judged.writer) return;
  judged = {frame.seq, frame.session, 0, frame.writer};
  if (frame.seq == ack) return;
  // The block that is being journalled, written back by another connection.
  if (phase == Phase::journalling && frame.seq == command.seq && frame.session == command.session &&
      frame.station == command.station)
    return;
  const bool stale = session != session_next || frame.session != session;
  if (rules.session_is_echoed && stale) return;
  if (phase == Phase::journalling || phase == Phase::storing) {
    // While a command is being journalled or scanned, any other number is wrong, and its successor is too early.
    if (phase == Phase::journalling || (rules.number_is_successor && frame.seq != next_sequence(ack))) return;
  }
  if (rules.number_is_successor && frame.seq != next_sequence(ack)) return;
  const bool takeover = writer != 0 && frame.writer != writer;
  writer = frame.writer;
  if (takeover && rules.one_connection_commands) {
    change_session(rules);
    if (rules.session_is_echoed) return;
  }
  const bool enabled = !rules.enable_is_required || (enable && heard);
  if (busy() || !enabled) {  // refused on its content, which uses up the number
    ack = frame.seq;
    status = Status::failed;
    return;
  }
  phase = Phase::journalling;
  command = command_stored = frame;
  ack_stored = frame.seq;
  status_stored = Status::accepted;
}

void Slabd::change_session(const Rules& rules) {
  const bool on_its_way = session != session_next;
  if (on_its_way && rules.session_is_durable_first) return;
  session_next = next_sequence(session_next);
  if (rules.session_is_durable_first)
    session_stored = session_next;
  else
    session = session_next;
}

void Slabd::synchronise(const Rules& rules) {
  if (rules.session_changes_on_request) change_session(rules);
}

void Slabd::session_was_stored() {
  session_stored = session = session_next;
}

void Slabd::command_was_stored() {
  phase = Phase::acquiring;
  ack = command.seq;
  status = Status::accepted;
}

void Slabd::scan(const Rules& rules) {
  const std::size_t index = command.station - 1U;
  phase = Phase::storing;
  if (rules.scan_is_durable_first) {
    has[index] = Has::cloud;
    acquired_stored = command.seq;
    status_stored = Status::acquired;
    return;
  }
  cloud_in_memory_only[index] = true;
  acquired = command.seq;
  if (ack == command.seq) status = Status::acquired;
}

void Slabd::scan_failed() {
  status_stored = Status::failed;
  if (ack == command.seq) status = Status::failed;
  phase = Phase::idle;
  command = {};
}

void Slabd::scan_was_stored() {
  const std::size_t index = command.station - 1U;
  has[index] = Has::cloud;
  cloud_in_memory_only[index] = false;
  acquired = acquired_stored = command.seq;
  status_stored = Status::acquired;
  if (ack == command.seq) status = Status::acquired;
  phase = Phase::idle;
  command = {};
}

void Slabd::measured(std::size_t index) {
  has[index] = Has::result;
  *std::find(results.begin(), results.end(), 0) = static_cast<std::uint8_t>(index + 1);
}

void Slabd::acknowledged() {
  std::move(results.begin() + 1, results.end(), results.begin());
  results.back() = 0;
}

void Slabd::die() {
  Slabd next;
  next.up = false;
  next.session_stored = next.session_next = session_stored;
  next.ack = next.ack_stored = ack_stored;
  next.acquired = next.acquired_stored = acquired_stored;
  next.command_stored = command_stored;
  next.status = next.status_stored = status_stored;
  next.has = has;
  next.results = results;
  next.session = session_stored;
  next.enable = enable;  // the PLC writes them repeatedly
  next.heard = heard;
  *this = next;
}

void Slabd::start(const Rules& rules) {
  up = true;
  if (!rules.result_is_kept) results = {};
  if (status_stored == Status::accepted && !rules.never_scans_by_itself) {
    phase = Phase::acquiring;
    command = command_stored;
  } else if (status_stored == Status::accepted) {
    status = status_stored = Status::failed;
  }
  if (!rules.session_changes_at_start) return;
  change_session(rules);
  if (rules.session_is_durable_first) session = 0;
}

void Slabd::lose_heartbeat() {
  heard = false;
  was_lost = up;
}

void Slabd::hear_heartbeat(const Rules& rules) {
  heard = true;
  if (was_lost && rules.session_changes_when_heard_again) change_session(rules);
  was_lost = false;
}

// ---- all possible steps --------------------------------------------------------------------------------------------

namespace {

/// A state as bytes, without the gaps of a struct.
using Key = std::array<char, 104>;
struct HashOfKey {
  std::size_t operator()(const Key& key) const {
    return std::hash<std::string_view>()(std::string_view(key.data(), key.size()));
  }
};

Key key_of(const World& w) {
  Key key{};
  std::size_t size = 0;
  const auto put = [&](auto value) {
    std::memcpy(&key.at(size + sizeof value - 1) - (sizeof value - 1), &value, sizeof value);
    size += sizeof value;
  };
  const auto put_frame = [&](const Frame& f) { put(f.seq), put(f.session), put(f.station), put(f.writer); };
  const Slabd& s = w.slabd;
  put(s.session_stored), put(s.ack_stored), put(s.acquired_stored), put(s.status_stored);
  put(s.session), put(s.session_next), put(s.ack), put(s.acquired), put(s.status), put(s.phase);
  for (std::size_t i = 0; i < kStations; ++i)
    put(s.has[i]), put(s.results[i]), put(s.cloud_in_memory_only[i]), put(w.plc.stored[i]), put(w.left[i]);
  put_frame(s.command), put_frame(s.judged), put_frame(w.plc.command), put_frame(w.wire);
  put_frame(s.command_stored), put_frame(w.stranger);
  for (const Frame& f : w.old) put_frame(f);
  put(s.up), put(s.writer), put(s.enable), put(s.heard), put(s.was_lost), put(w.given_up), put(w.strangers);
  put(w.plc.phase), put(w.plc.session_before), put(w.plc.own_count), put(w.plc.target), put(w.plc.to_store);
  put(w.robot), put(w.deaths), put(w.repeats), put(w.failures);
  return key;
}

struct Step {
  std::string what;
  World world;
  bool mishap = false;    ///< a death, a repetition, a failed scan, a lost block: progress must be possible without it
  std::string violation;  ///< of this step
};

class Steps {
 public:
  Steps(const Rules& rules, const Mishaps& mishaps, bool tell) : rules_(rules), mishaps_(mishaps), tell_(tell) {}

  std::vector<Step> from(const World& w) {
    steps_.clear();
    slabd_steps(w);
    plc_steps(w);
    link_steps(w);
    return std::move(steps_);
  }

 private:
  template <typename... Args>
  World& add(const World& from, const char* what, const Args&... args) {
    steps_.push_back({tell_ ? fmt::format(fmt::runtime(what), args...) : std::string(), from, false, {}});
    return steps_.back().world;
  }
  template <typename... Args>
  World& mishap(const World& from, const char* what, const Args&... args) {
    World& next = add(from, what, args...);
    steps_.back().mishap = true;
    return next;
  }

  void slabd_steps(const World& w) {
    const Slabd& s = w.slabd;
    if (!s.up) {
      add(w, "slabd starts").slabd.start(rules_);
      return;
    }
    if (s.session != s.session_next || s.session_stored != s.session_next)
      add(w, "session {} is durable and shown", s.session_next).slabd.session_was_stored();
    if (s.phase == Slabd::Phase::journalling)
      add(w, "command {} is durable, CMD_ACK", s.command.seq).slabd.command_was_stored();
    if (s.phase == Slabd::Phase::acquiring) {
      add(w, "station {} is scanned, the robot stands at {}", s.command.station, w.robot).slabd.scan(rules_);
      if (w.robot != s.command.station)
        steps_.back().violation =
            fmt::format("station {} was scanned while the robot stood at {}", s.command.station, w.robot);
      if (w.failures < mishaps_.failures) {
        World& next = mishap(w, "the scan of station {} fails", s.command.station);
        next.slabd.scan_failed();
        ++next.failures;
      }
    }
    if (s.phase == Slabd::Phase::storing)
      add(w, "cloud and pose of station {} are durable", s.command.station).slabd.scan_was_stored();
    const bool one_at_a_time = s.phase != Slabd::Phase::storing;
    for (std::size_t i = 0; i < kStations; ++i)
      if (s.has[i] == Has::cloud && one_at_a_time)
        add(w, "station {} is measured, the result is durable", i + 1).slabd.measured(i);
    if (w.deaths < mishaps_.deaths) {
      World& next = mishap(w, "slabd dies");
      next.slabd.die();
      ++next.deaths;
    }
  }

  void plc_steps(const World& w) {
    const Slabd& s = w.slabd;
    const Plc& p = w.plc;
    if (w.deaths < mishaps_.deaths) {
      World& next = mishap(w, "the PLC dies and starts again");
      Plc fresh;
      fresh.stored = p.stored;
      next.plc = fresh;
      if (mishaps_.deaths_are_noticed) next.slabd.lose_heartbeat();
      ++next.deaths;
    }
    give_up(w);
    if (!s.up) return;  // no data can be read, and old data do not count
    results(w);
    switch (p.phase) {
      case Plc::Phase::started: {
        World& next = add(w, rules_.synchronises ? "PLC: starts, SYNC_REQ" : "PLC: starts");
        next.plc.phase = Plc::Phase::synchronising;
        next.plc.session_before = s.session;
        next.slabd.enable = true;
        next.slabd.hear_heartbeat(rules_);
        if (rules_.synchronises) next.slabd.synchronise(rules_);
        break;
      }
      case Plc::Phase::synchronising: {
        const bool fresh = s.session != p.session_before || !rules_.session_changes_on_request || !rules_.synchronises;
        if (!fresh || s.session == 0 || (rules_.restarted_plc_waits && s.busy())) break;
        add(w, "PLC: new session, not BUSY; the robot may be moved").plc.phase = Plc::Phase::homing;
        break;
      }
      case Plc::Phase::homing: {
        World& next = add(w, "the robot goes home");
        next.plc.phase = Plc::Phase::choosing;
        next.robot = 0;
        break;
      }
      case Plc::Phase::choosing: choose(w); break;
      case Plc::Phase::commanding: command(w); break;
      case Plc::Phase::awaiting: await(w); break;
      case Plc::Phase::in_hand: {
        World& next = add(w, "the operator gives the line back");
        next.plc.phase = Plc::Phase::started;  // ENABLE with the same write as SYNC_REQ
        if (rules_.given_up_means_synchronise) break;
        next.slabd.enable = true;
        next.plc.phase = Plc::Phase::choosing;
        break;
      }
      case Plc::Phase::finished: break;
    }
  }

  /// An order without an answer is given up; then the robot may move only after the order is void. Or an operator takes
  /// manual control of the line and moves the robot, with ENABLE off. Neither while slabd is BUSY, as far as that can
  /// be read.
  void give_up(const World& w) {
    const Plc& p = w.plc;
    const bool may = p.phase == Plc::Phase::choosing || p.phase == Plc::Phase::commanding ||
                     (p.phase == Plc::Phase::awaiting && !w.slabd.up);
    const bool busy = w.slabd.up && w.slabd.busy() && rules_.restarted_plc_waits;
    if (!may || busy || w.given_up >= mishaps_.given_up) return;
    const auto give_up = [&](const char* what) -> World& {
      World& next = mishap(w, what);
      next.plc.command = {};
      next.plc.target = 0;
      ++next.given_up;
      return next;
    };
    World& in_hand = give_up("the operator takes the line in hand and moves the robot away");
    in_hand.slabd.enable = false;
    in_hand.plc.phase = Plc::Phase::in_hand;
    in_hand.robot = 0;
    if (p.phase == Plc::Phase::choosing) return;
    World& next = give_up("PLC: gives the order up");
    next.plc.phase = rules_.given_up_means_synchronise ? Plc::Phase::started : Plc::Phase::homing;
  }

  void results(const World& w) {
    const std::uint8_t front = w.slabd.results.front();
    if (w.plc.to_store != 0) {
      World& next = add(w, "PLC: stores the result of station {}", w.plc.to_store);
      next.plc.stored[w.plc.to_store - 1U] = true;
      next.plc.to_store = 0;
    } else if (front != 0 && rules_.result_is_stored_first && !w.plc.stored[front - 1U]) {
      add(w, "PLC: stores the result of station {}", front).plc.stored[front - 1U] = true;
    } else if (front != 0) {
      World& next = add(w, "PLC: RES_ACK for station {}", front);
      if (!rules_.result_is_stored_first) next.plc.to_store = front;
      next.slabd.acknowledged();
    }
  }

  /// Selects the next station that is not in slabd's table and whose result the PLC does not have.
  void choose(const World& w) {
    for (std::size_t i = 0; i < kStations; ++i) {
      if (w.plc.stored[i] || w.slabd.has[i] != Has::nothing || w.slabd.cloud_in_memory_only[i]) continue;
      World& next = add(w, "the robot goes to station {}", i + 1);
      next.robot = next.plc.target = static_cast<std::uint8_t>(i + 1);
      next.plc.phase = Plc::Phase::commanding;
      next.plc.command = {};
      return;
    }
    add(w, "PLC: all stations are done").plc.phase = Plc::Phase::finished;
  }

  void send(World& next) {
    Frame frame;
    frame.seq = next_sequence(rules_.number_follows_ack ? next.slabd.ack : next.plc.own_count);
    frame.session = next.slabd.session;
    frame.station = next.plc.target;
    next.plc.own_count = frame.seq;
    next.plc.command = next.wire = frame;
  }

  /// Writes the block; repeats it until it is answered; makes a new one when the session or the number has changed.
  void command(const World& w) {
    const Slabd& s = w.slabd;
    const Frame& mine = w.plc.command;
    if (mine.station != 0 && s.ack == mine.seq) {
      add(w, "PLC: command {} is acknowledged", mine.seq).plc.phase = Plc::Phase::awaiting;
      return;
    }
    if (w.wire.station != 0 || s.session == 0) return;
    const bool void_now = mine.station == 0 || mine.session != s.session || mine.seq != next_sequence(s.ack);
    if (void_now && !(mine.station != 0 && !rules_.number_follows_ack && mine.session == s.session)) {
      World& next = add(w, "PLC: SCAN {} as command {} in session {}", w.plc.target,
                        next_sequence(rules_.number_follows_ack ? s.ack : w.plc.own_count), s.session);
      send(next);
    } else {
      add(w, "PLC: writes command {} again", mine.seq).wire = mine;
    }
  }

  void await(const World& w) {
    const Slabd& s = w.slabd;
    const Frame& mine = w.plc.command;
    const auto leave = [&](const char* why) {
      World& next = add(w, "PLC: {}, the robot leaves station {}", why, mine.station);
      next.left[mine.station - 1U] = true;
      next.robot = 0;
      next.plc.phase = Plc::Phase::choosing;
    };
    if (s.ack != mine.seq) {
      add(w, "PLC: slabd works on another command; looks again").plc.phase = Plc::Phase::choosing;
    } else if (s.status == Status::failed) {
      add(w, "PLC: command {} came to nothing", mine.seq).plc.phase = Plc::Phase::choosing;
    } else if (s.status == Status::acquired) {
      leave("ACQUIRED");
    } else if (!rules_.robot_waits_for_acquired) {
      leave("does not wait for ACQUIRED");
    }
  }

  void link_steps(const World& w) {
    if (w.wire.station != 0) {
      World& next = add(w, "command {} arrives", w.wire.seq);
      next.slabd.receive(w.wire, rules_);
      remember(next, w.wire);
      next.wire = {};
      World& lost = mishap(w, "command {} gets lost", w.wire.seq);
      remember(lost, w.wire);
      lost.wire = {};
    }
    strangers(w);
    if (w.repeats >= mishaps_.repeats) return;
    for (const Frame& frame : w.old) {
      if (frame.station == 0) continue;
      World& next = mishap(w, "an old block comes again: SCAN {} as command {} in session {}", frame.station, frame.seq,
                           frame.session);
      next.slabd.receive(frame, rules_);
      ++next.repeats;
    }
  }
  /// A second client that could be the PLC: a spare PLC, a panel, a laptop. It uses the right numbers, but not the
  /// robot's position.
  void strangers(const World& w) {
    const Slabd& s = w.slabd;
    if (w.stranger.station != 0) {
      World& next =
          mishap(w, "the second commander's block arrives: SCAN {} as command {}", w.stranger.station, w.stranger.seq);
      next.slabd.receive(w.stranger, rules_);
      next.stranger = {};
    } else if (w.strangers < mishaps_.strangers && s.up && s.session != 0 && s.writer == kPlc) {
      for (std::uint8_t station = 1; station <= kStations; ++station) {
        World& next = mishap(w, "a second commander reads CMD_ACK {} and SESSION {}", s.ack, s.session);
        next.stranger = {next_sequence(s.ack), s.session, station, kStranger};
        ++next.strangers;
      }
    }
  }
  static void remember(World& w, const Frame& frame) {
    if (w.old[0] == frame || w.old[1] == frame) return;
    w.old[1] = w.old[0];
    w.old[0] = frame;
  }

  const Rules& rules_;
  const Mishaps& mishaps_;
  bool tell_;
  std::vector<Step> steps_;
};

/// Conditions for every state.
std::string violation_of(const World& w) {
  for (std::size_t i = 0; i < kStations; ++i) {
    const Slabd& s = w.slabd;
    const bool durable = s.has[i] != Has::nothing;
    const bool skipped = w.plc.phase == Plc::Phase::finished;
    const bool only_now = s.cloud_in_memory_only[i];
    if ((w.left[i] || skipped) && !durable && !only_now && !w.plc.stored[i])
      return fmt::format("station {} was left and its scan is lost", i + 1);
    const bool waits = std::find(s.results.begin(), s.results.end(), i + 1) != s.results.end();
    if (s.has[i] == Has::result && !waits && !w.plc.stored[i] && w.plc.to_store != i + 1)
      return fmt::format("the result of station {} is lost", i + 1);
  }
  return {};
}

bool finished(const World& w) {
  return w.plc.phase == Plc::Phase::finished &&
         std::all_of(w.plc.stored.begin(), w.plc.stored.end(), [](bool b) { return b; });
}

struct Seen {
  World world;
  std::uint32_t from = 0;
};

class Explorer {
 public:
  Explorer(const Rules& rules, const Mishaps& mishaps) : rules_(rules), mishaps_(mishaps) {}

  Finding explore() {
    Finding finding = look_at_everything();
    finding.states = seen_.size();
    return finding;
  }

 private:
  Finding look_at_everything() {
    note(World{}, 0);
    std::vector<std::pair<std::uint32_t, std::uint32_t>> good;  // to, from: steps without a mishap
    Steps steps(rules_, mishaps_, false);
    for (std::uint32_t at = 0; at < seen_.size(); ++at) {
      const World world = seen_[at].world;
      for (const Step& step : steps.from(world)) {
        const std::uint32_t next = note(step.world, at);
        if (!step.mishap) good.emplace_back(next, at);
        std::string violation = step.violation.empty() ? violation_of(step.world) : step.violation;
        if (violation.empty()) continue;
        std::vector<std::string> story = story_of(at);
        story.push_back(told(world, step.world));
        return {0, std::move(violation), std::move(story)};
      }
    }
    const std::size_t stuck = find_stuck(good);
    if (stuck == seen_.size()) return {};
    return {0, "the slab cannot be finished any more", story_of(stuck)};
  }

  /// Returns the state's number; a new state was reached from `from`.
  std::uint32_t note(const World& world, std::uint32_t from) {
    const auto [place, fresh] = known_.try_emplace(key_of(world), static_cast<std::uint32_t>(seen_.size()));
    if (fresh) seen_.push_back({world, from});
    return place->second;
  }

  /// Searches backwards from the finished slabs: states that are not reached are stuck, even without further mishaps.
  std::size_t find_stuck(std::vector<std::pair<std::uint32_t, std::uint32_t>>& good) const {
    std::sort(good.begin(), good.end());
    std::vector<bool> can_finish(seen_.size(), false);
    std::vector<std::uint32_t> left;
    const auto reach = [&](std::uint32_t at) {
      if (!can_finish[at]) can_finish[at] = true, left.push_back(at);
    };
    for (std::uint32_t i = 0; i < seen_.size(); ++i)
      if (finished(seen_[i].world)) reach(i);
    while (!left.empty()) {
      const std::uint32_t at = left.back();
      left.pop_back();
      for (auto step = std::lower_bound(good.begin(), good.end(), std::pair{at, 0U});
           step != good.end() && step->first == at; ++step)
        reach(step->second);
    }
    return static_cast<std::size_t>(std::find(can_finish.begin(), can_finish.end(), false) - can_finish.begin());
  }

  [[nodiscard]] std::string told(const World& from, const World& to) const {
    for (const Step& step : Steps(rules_, mishaps_, true).from(from))
      if (step.world == to) return step.what;
    return "?";
  }
  [[nodiscard]] std::vector<std::string> story_of(std::size_t at) const {
    std::vector<std::string> story;
    for (; at != 0; at = seen_[at].from) story.push_back(told(seen_[seen_[at].from].world, seen_[at].world));
    std::reverse(story.begin(), story.end());
    return story;
  }

  const Rules& rules_;
  const Mishaps& mishaps_;
  std::vector<Seen> seen_;
  std::unordered_map<Key, std::uint32_t, HashOfKey> known_;
};

}  // namespace

Finding explore(const Rules& rules, const Mishaps& mishaps) {
  return Explorer(rules, mishaps).explore();
}

}  // namespace slabd::handshake
