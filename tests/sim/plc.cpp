// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/plc.h"

#include <algorithm>
#include <cassert>

namespace slabd::sim {
namespace {

constexpr std::int64_t kReplyTimeout = 400 * kMs;
constexpr std::int64_t kCycle = 40 * kMs;
constexpr std::int64_t kQuietCycle = 200 * kMs;
constexpr std::int64_t kBeat = 400 * kMs;
constexpr std::int64_t kAckTimeout = 500 * kMs;
constexpr int kRewritesMax = 3;
constexpr int kAttemptsMax = 8;
constexpr int kTriesMax = 6;

void put_u16(Frame& out, std::size_t value) {
  out.push_back(static_cast<std::uint8_t>((value >> 8U) & 0xFFU));
  out.push_back(static_cast<std::uint8_t>(value & 0xFFU));
}

Frame read_pdu() {
  Frame pdu{4};
  put_u16(pdu, 0);
  put_u16(pdu, hal::kInputRegisters);
  return pdu;
}

Frame write_pdu(const hal::HoldingImage& image, std::size_t first, std::size_t count) {
  Frame pdu{16};
  put_u16(pdu, first);
  put_u16(pdu, count);
  pdu.push_back(static_cast<std::uint8_t>(2 * count));
  for (std::size_t i = first; i < first + count; ++i) put_u16(pdu, image[i]);
  return pdu;
}

}  // namespace

Plc::Plc(World& world, Line& line, Wire& wire) : world_(world), line_(line), wire_(wire), chance_(world.chance(8)) {
  out_.enable = true;
  connection_ = wire_.connect();
}

std::int64_t Plc::next_ns() const {
  if (world_.now_ns < off_until_ns_) return off_until_ns_;
  if (outstanding_ != Transfer::none) return std::min(deadline_ns_, wire_.next_reply_ns());
  return cycle_ns_;
}

void Plc::restart() {
  world_.trace.line(world_.now_ns, "PLC: loses power");
  off_until_ns_ = world_.now_ns + between(chance_, kSecond, 15 * kSecond);
  out_ = {};
  out_.enable = true;
  out_.sync_req = kept_.sync;
  seen_ = {};
  image_ = {};
  ever_seen_ = synced_ = session_asked_ = false;
  outstanding_ = Transfer::none;
  want_control_ = want_command_ = false;
  step_ = Step::idle;
  reset_ = 0;
  going_to_ = 0;
  vanished_ns_ = 0;
  cycle_ns_ = off_until_ns_;
}

// ---- the link ----------------------------------------------------------------------------------------------------

void Plc::act() {
  if (world_.now_ns < off_until_ns_) return;
  Frame frame;
  while (outstanding_ != Transfer::none && wire_.receive(connection_, frame)) on_reply(frame);
  if (outstanding_ != Transfer::none && world_.now_ns >= deadline_ns_) {
    // After any silence a new connection is opened; otherwise a late answer would be assigned to the next request.
    outstanding_ = Transfer::none;
    connection_ = wire_.connect();
    cycle_ns_ = world_.now_ns + 100 * kMs;
    if (want_command_) want_command_ = step_ == Step::wait_ack;
  }
  if (outstanding_ == Transfer::none && world_.now_ns >= cycle_ns_) transfer();
}

void Plc::transfer() {
  hal::HoldingImage image{};
  hal::encode_inputs(out_, hal::WordOrder::abcd, true, image);
  if (want_command_) {
    want_command_ = false;
    send(Transfer::command, write_pdu(image, hal::kCommandFirst, hal::kCommandLast - hal::kCommandFirst + 1));
  } else if (want_control_) {
    want_control_ = false;
    send(Transfer::control, write_pdu(image, 0, 4));
  } else {
    send(Transfer::read, read_pdu());
  }
}

void Plc::send(Transfer what, const Frame& pdu) {
  Frame frame;
  put_u16(frame, ++transaction_);
  put_u16(frame, 0);
  put_u16(frame, pdu.size() + 1);
  frame.push_back(1);
  frame.insert(frame.end(), pdu.begin(), pdu.end());
  outstanding_ = what;
  deadline_ns_ = world_.now_ns + kReplyTimeout;
  wire_.send(connection_, std::move(frame));
}

void Plc::on_reply(const Frame& frame) {
  const bool ours = frame.size() > hal::kMbapBytes + 1 && frame[0] == (transaction_ >> 8U) &&
                    frame[1] == (transaction_ & 0xFFU) && frame[2] == 0 && frame[3] == 0 &&
                    frame.size() == 6U + frame[4] * 256U + frame[5];
  if (!ours) return;  // an answer to another request, or a corrupt one
  const Transfer what = std::exchange(outstanding_, Transfer::none);
  const bool quiet = kept_.stage == Stage::none && !seen_.busy && !seen_.result && synced_;
  cycle_ns_ = world_.now_ns + (what != Transfer::read ? 2 * kMs : quiet ? kQuietCycle : kCycle);
  if (what != Transfer::read || frame[7] != 4 || frame.size() != hal::kMbapBytes + 2 + 2 * hal::kInputRegisters) return;
  hal::InputImage image{};
  for (std::size_t i = 0; i < image.size(); ++i)
    image[i] = static_cast<std::uint16_t>(frame[9 + 2 * i] * 256U + frame[10 + 2 * i]);
  const Result<PlcOutputs> outputs = hal::decode_outputs(image, hal::WordOrder::abcd);
  if (!outputs.ok()) return;  // not slabd, or corrupt
  image_ = image;
  seen_ = outputs.value();
  ever_seen_ = true;
  think();
}

// ---- the program -------------------------------------------------------------------------------------------------

void Plc::think() {
  if (!session_asked_) {
    session_asked_ = true;
    session_old_ = seen_.session;
    kept_.sync = static_cast<std::uint16_t>(kept_.sync + 1U);
    out_.sync_req = kept_.sync;
    want_control_ = true;
  }
  if (seen_.session != session_old_) synced_ = true;
  if (world_.now_ns - beat_ns_ >= kBeat) {
    beat_ns_ = world_.now_ns;
    ++out_.heartbeat;
    want_control_ = true;
  }
  const bool enable = world_.now_ns >= wishes.disabled_until_ns;
  bool abort = false;
  if (wishes.abort && seen_.busy) {
    wishes.abort = false;
    abort = true;
  }
  // The operator, or the program, resets a fault every few seconds.
  bool fault_reset = false;
  if (seen_.fault_present && world_.now_ns - fault_reset_ns_ > 4 * kSecond) {
    fault_reset_ns_ = world_.now_ns;
    fault_reset = true;
  }
  if (enable != out_.enable || abort != out_.abort || fault_reset != out_.fault_reset) want_control_ = true;
  out_.enable = enable;
  out_.abort = abort;
  out_.fault_reset = fault_reset;
  store_result();
  run_order();
  if (step_ == Step::idle) plan();
}

void Plc::store_result() {
  if (!seen_.result || !hal::record_intact(image_)) return;
  const PlcResult& record = seen_.record;
  const Key key{record.slab_no, record.kind, record.station, record.cmd_seq};
  const auto [at, added] = kept_.results.try_emplace(key, record);
  const PlcResult& known = at->second;
  if (!added &&
      (known.verdict != record.verdict || known.reason != record.reason || known.fail_mask != record.fail_mask))
    world_.violated("slab %u station %u command %u was shown as %s and then as %s", record.slab_no, record.station,
                    record.cmd_seq, name(known.verdict).data(), name(record.verdict).data());
  if (out_.res_ack == record.res_seq) return;
  out_.res_ack = record.res_seq;
  want_control_ = true;
}

void Plc::order(PlcCommand command, int station) {
  out_.command = static_cast<std::uint16_t>(command);
  out_.station = static_cast<std::uint16_t>(station);
  out_.slab_type = kept_.type;
  out_.slab_no = kept_.slab_no;
  out_.slab_id = {};
  const std::string id = "SLAB " + std::to_string(kept_.slab_no);
  std::copy(id.begin(), id.end(), out_.slab_id.begin());
  step_ = Step::issue;
  attempts_ = 0;
}

void Plc::run_order() {
  const std::int64_t waited_ns = world_.now_ns - step_ns_;
  const auto go = [&](Step step) {
    step_ = step;
    step_ns_ = world_.now_ns;
  };
  switch (step_) {
    case Step::idle: break;
    case Step::issue:
      if (++attempts_ > kAttemptsMax) {
        order_ended(false, Code::ok);
        break;
      }
      out_.session_echo = seen_.session;
      out_.cmd_seq = next_sequence(seen_.cmd_ack);
      refused_before_ = seen_.refused;
      rewrites_ = 0;
      if (out_.command == static_cast<std::uint16_t>(PlcCommand::slab_end) ||
          out_.command == static_cast<std::uint16_t>(PlcCommand::slab_abort))
        kept_.end_seqs.push_back(out_.cmd_seq);
      world_.trace.line(world_.now_ns, "PLC: order %u, station %u, slab %u, number %u, session %u", out_.command,
                        out_.station, out_.slab_no, out_.cmd_seq, out_.session_echo);
      want_command_ = true;
      go(Step::wait_ack);
      break;
    case Step::wait_ack:
      if (seen_.cmd_ack == out_.cmd_seq) {
        if (seen_.cmd_status >= kCommandFailed) {
          const auto code = static_cast<Code>(seen_.cmd_status - kCommandFailed);
          if (code == Code::busy || code == Code::not_enabled)
            go(Step::wait_free);
          else
            order_ended(false, code);
        } else {
          go(Step::running);
        }
      } else if ((seen_.refused != refused_before_ && seen_.refuse_seq == out_.cmd_seq) ||
                 seen_.session != out_.session_echo) {
        go(Step::wait_ready);
      } else if (waited_ns > kAckTimeout) {
        if (rewrites_++ == kRewritesMax) {
          order_ended(false, Code::ok);
        } else {
          want_command_ = true;  // the same number
          go(Step::wait_ack);
        }
      }
      break;
    case Step::wait_ready:
      if (seen_.ready)
        go(Step::issue);
      else if (waited_ns > 3 * kSecond)
        order_ended(false, Code::ok);
      break;
    case Step::wait_free:
      if (!seen_.busy && seen_.plc_link_ok && out_.enable)
        go(Step::issue);
      else if (waited_ns > 60 * kSecond)
        order_ended(false, Code::busy);
      break;
    case Step::running: {
      if (seen_.cmd_ack != out_.cmd_seq) {
        order_ended(false, Code::interrupted);
        break;
      }
      if (seen_.cmd_status >= kCommandFailed) {
        order_ended(false, static_cast<Code>(seen_.cmd_status - kCommandFailed));
        break;
      }
      const bool ending = out_.command == static_cast<std::uint16_t>(PlcCommand::slab_end);
      if (ending && wishes.abort_after_end_ns >= 0 && waited_ns >= wishes.abort_after_end_ns) {
        wishes.abort_after_end_ns = -1;
        kept_.giving_up = true;  // the operator gives up
        order(PlcCommand::slab_abort, 0);
        break;
      }
      const bool scan = out_.command == static_cast<std::uint16_t>(PlcCommand::scan);
      const auto goal = static_cast<std::uint16_t>(scan ? CommandStatus::acquired : CommandStatus::done);
      if (seen_.cmd_status >= goal)
        order_ended(true, Code::ok);
      else if (waited_ns > (scan ? 20 : 60) * kSecond)
        order_ended(false, Code::ok);
      break;
    }
  }
}

void Plc::order_ended(bool done, Code code) {
  step_ = Step::idle;
  world_.trace.line(world_.now_ns, "PLC: order %u %s, code %u", out_.command, done ? "done" : "came to nothing",
                    static_cast<unsigned>(code));
  const auto command = static_cast<PlcCommand>(out_.command);
  if (command == PlcCommand::slab_begin && done) kept_.stage = Stage::scan;
  if (command == PlcCommand::scan && !done && code != Code::ok && code != Code::interrupted && code != Code::busy) {
    if (++kept_.tries[static_cast<std::size_t>(out_.station - 1)] >= kTriesMax) {
      kept_.giving_up = true;
      kept_.stage = Stage::end;
    }
  }
  if (command == PlcCommand::slab_end && code == Code::unknown_type) kept_.giving_up = true;
  // An end that could not be recorded leaves the slab open, so that a block may be scanned again.
  if (command == PlcCommand::slab_end && code == Code::journal_write && happens(chance_, 0.3)) {
    kept_.stage = Stage::scan;
    wishes.rescan = true;
  }
}

void Plc::plan() {
  if (!synced_ || seen_.busy || !out_.enable || !seen_.plc_link_ok || seen_.state == PlcState::maintenance) return;
  if (kept_.stage == Stage::none) {
    if (world_.now_ns < pause_until_ns_ || resting) return;
    line_.lay_down(!next_is_good && happens(chance_, 0.1), next_is_good);
    kept_.stage = Stage::begin;
    kept_.slab_no = line_.slab.slab_no;
    kept_.type = line_.slab.recipe->slab_type;
    kept_.stations = line_.slab.recipe->stations();
    kept_.giving_up = false;
    kept_.end_seqs.clear();
    kept_.tries = {};
    return;
  }
  plan_slab();
}

void Plc::plan_slab() {
  const bool open = seen_.slab_open && seen_.slab_no == kept_.slab_no;
  for (const std::uint16_t seq : kept_.end_seqs) {
    const auto found = kept_.results.find({kept_.slab_no, std::uint16_t{2}, std::uint16_t{0}, seq});
    if (found == kept_.results.end()) continue;
    decide(found->second);
    return;
  }
  if (seen_.fault_present && !(kept_.giving_up && open)) return;
  switch (kept_.stage) {
    case Stage::none: break;
    case Stage::begin:
      if (open)
        kept_.stage = Stage::scan;
      else if (seen_.slab_open) {
        // Begun by a command whose answer was lost, or by another client: SLAB_ABORT with its own number ends it.
        order(PlcCommand::slab_abort, 0);
        out_.slab_no = seen_.slab_no;
      } else
        order(PlcCommand::slab_begin, 0);
      break;
    case Stage::scan: {
      if (!open) {
        // The slab was open, and no command has ended it.
        if (vanished_ns_ == 0) vanished_ns_ = world_.now_ns;
        if (world_.now_ns - vanished_ns_ > 10 * kSecond)
          world_.violated("slab %u was open and is not any more", kept_.slab_no);
        return;
      }
      vanished_ns_ = 0;
      if (std::exchange(wishes.slab_abort, false)) {
        kept_.giving_up = true;
        kept_.stage = Stage::end;
        return;
      }
      if (std::exchange(wishes.report, false) && seen_.station_mask != 0) {
        order(PlcCommand::report, 1 + std::countr_zero(seen_.station_mask));
        return;
      }
      const auto missing = [this](int k) { return (seen_.station_mask & (1U << static_cast<unsigned>(k - 1))) == 0; };
      int next = 0;
      for (int k = 1; k <= kept_.stations && next == 0; ++k)
        if (missing(k)) next = k;
      // A program that returns later to blocks that failed.
      if (next != 0 && world_.faulty(Fault::plc_elsewhere)) {
        next = going_to_;
        while (next == 0 || !missing(next)) next = static_cast<int>(between(chance_, 1, kept_.stations));
      }
      if (wishes.rescan && seen_.station_mask != 0) next = 1 + std::countr_zero(seen_.station_mask);
      if (next == 0) {
        kept_.stage = Stage::end;
        return;
      }
      if (going_to_ != next) {
        going_to_ = next;
        const bool wrong = std::exchange(wishes.wrong_station, false);
        send_robot(next, wrong ? 1 + next % kept_.stations : next);
        return;
      }
      // Often sent before the robot has arrived, because slabd waits for that.
      if (!line_.robots[arm_].arrived() && happens(chance_, 0.8)) return;
      going_to_ = 0;
      wishes.rescan = false;
      order(PlcCommand::scan, next);
      break;
    }
    case Stage::end:
      if (open) {
        order(kept_.giving_up ? PlcCommand::slab_abort : PlcCommand::slab_end, 0);
      } else if (std::exchange(wishes.report, false)) {
        order(PlcCommand::report, 0);
      }
      break;
  }
}

/// Sends the usual robot of station `next` to `target`. After a failure, where both may scan, it may send the other one
/// and move the usual one aside, because that one scans if both look at the block.
void Plc::send_robot(int next, int target) {
  const auto i = static_cast<std::size_t>(next - 1);
  const ArmChoice& choice = line_.arms.of_station[i];
  arm_ = choice[0];
  if (choice.size() > 1 && kept_.tries[i] > 0 && happens(chance_, 0.5)) {
    line_.robots[arm_].go_home();
    arm_ = choice[1];
  }
  line_.robots[arm_].go_to(*line_.slab.recipe, target);
}

void Plc::decide(const PlcResult& record) {
  Decision decision;
  decision.slab_no = record.slab_no;
  decision.cmd_seq = record.cmd_seq;
  decision.verdict = record.verdict;
  decided(decision);
  finish_slab();
}

void Plc::finish_slab() {
  line_.take_away();
  kept_.stage = Stage::none;
  vanished_ns_ = 0;
  pause_until_ns_ = world_.now_ns + between(chance_, kSecond, 40 * kSecond);
}

}  // namespace slabd::sim
