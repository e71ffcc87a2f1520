// SPDX-License-Identifier: Apache-2.0
//
// slabctl plc command: gives one command of the PLC by hand, for commissioning without a PLC program. It takes the
// PLC's place for this command (emulator/plc_peer.h) and therefore never begins while a PLC commands or while a result
// waits for it: an acknowledged result would never reach the PLC.
#include <fmt/core.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "cli/exit.h"
#include "cli/plc/plc.h"
#include "cli/terminal/arguments.h"
#include "emulator/plc_peer.h"
#include "report/words.h"

namespace slabd::cli {
namespace {

using emulator::PlcClock;
using emulator::PlcOrder;
using emulator::PlcPeer;
using emulator::PlcTraits;
using emulator::PlcTrouble;
using emulator::StoredResult;

std::atomic<bool> g_interrupted{false};

struct Options {
  std::string config;
  std::string device;
  std::string word;
  int station = 0;
  std::uint32_t slab_no = 0;
  std::uint16_t slab_type = 0;
  std::string slab_id;
  std::string second_chip;
  std::uint16_t mould = 0;
  bool take_results = false;
};

/// slabd notices the end of a PLC's heartbeat after 2.5 s.
constexpr std::chrono::milliseconds kHeartbeatLost{3'000};
constexpr std::chrono::milliseconds kPeriod{100};
/// Several polls of slabd in the client role.
constexpr std::chrono::milliseconds kAcknowledged{3'000};

/// "scan", "SLAB_BEGIN", "slab-begin" or "begin"; none for another word.
PlcCommand command_named(std::string word) {
  std::transform(word.begin(), word.end(), word.begin(),
                 [](unsigned char c) { return c == '-' ? '_' : static_cast<char>(std::toupper(c)); });
  if (word == "SCAN") return PlcCommand::scan;
  if (word == "SLAB_BEGIN" || word == "BEGIN") return PlcCommand::slab_begin;
  if (word == "SLAB_END" || word == "END") return PlcCommand::slab_end;
  if (word == "SLAB_ABORT" || word == "ABORT") return PlcCommand::slab_abort;
  return PlcCommand::none;
}

PlcOutputs outputs_now(const config::Config& config) {
  const PlcRegisters registers = need(plc_registers(config));
  return need(hal::decode_outputs(registers.input, registers.order));
}

/// The state of slabd when no PLC commands and no result waits; otherwise stops.
PlcOutputs wait_for_control(const config::Config& config, bool take_results) {
  const auto until = PlcClock::now() + kHeartbeatLost;
  PlcOutputs seen = outputs_now(config);
  // The heartbeat of an earlier command by hand is remembered for some seconds too.
  while (seen.plc_link_ok && PlcClock::now() < until && !g_interrupted) {
    std::this_thread::sleep_for(kPeriod);
    seen = outputs_now(config);
  }
  if (g_interrupted) stop(kRefused, "interrupted; no command was given");
  if (seen.plc_link_ok)
    stop(kRefused, "a PLC commands: its heartbeat (HR 0) changes. Stop its program, or take it off the network, first");
  if (seen.fault_present) {
    const auto fault = static_cast<Code>(seen.fault);
    stop(kRefused, fmt::format("slabd reports fault {}: {}; {}", seen.fault, describe(fault), cure(fault)));
  }
  if ((seen.result || seen.results_pending > 0) && !take_results)
    stop(kRefused,
         "a result waits for the PLC, which would never receive it after a command by hand; let the PLC run and fetch "
         "it, or give --take-results, which prints and acknowledges it");
  return seen;
}

PlcOrder order_of(const Options& options, PlcCommand command, const PlcOutputs& seen) {
  PlcOrder order;
  order.command = command;
  if (command == PlcCommand::slab_begin) {
    if (options.slab_no == 0 || options.slab_type == 0)
      stop(kUsage, "SLAB_BEGIN needs --slab-no and --slab-type, which is slab_type of a recipe, such as 5600");
    if (seen.slab_open)
      stop(kRefused,
           fmt::format("slab {} is open; end it first: slabctl plc command SLAB_END, or SLAB_ABORT", seen.slab_no));
    order.slab_no = options.slab_no;
    order.slab_type = options.slab_type;
    order.slab_id = options.slab_id;
    order.second_chip = options.second_chip;
    order.mould = options.mould;
    return order;
  }
  if (!seen.slab_open)
    stop(kRefused, "no slab is open; first: slabctl plc command SLAB_BEGIN --slab-no 1 --slab-type 5600");
  order.slab_no = seen.slab_no;
  order.slab_type = seen.slab_type;
  order.station = command == PlcCommand::scan ? options.station : 0;
  return order;
}

std::string result_line(const PlcResult& record) {
  const std::string what = record.kind == 2 ? fmt::format("slab {}", record.slab_no)
                                            : fmt::format("slab {} block {}", record.slab_no, record.station);
  std::string words(name(record.verdict));
  std::replace(words.begin(), words.end(), '_', ' ');
  const std::string why = record.reason == 0 ? "" : ": " + report::reason_sentence(record.reason, report::Language::en);
  return fmt::format("{}: {}{}\n", what, words, why);
}

[[noreturn]] void stop_with(const PlcTrouble& trouble) {
  stop(trouble.link_lost || trouble.code == Code::ok ? kNotReachable : kRefused, trouble.text);
}

/// Waits for the effect of the command, telling each step. The verdict, or none if the command has none.
Verdict follow(PlcPeer& plc, const PlcOrder& order, std::uint16_t cmd_seq, PlcClock::time_point written,
               const PlcTraits& traits) {
  const auto since = [&] { return std::chrono::duration<double>(PlcClock::now() - written).count(); };
  const auto tell = [](const std::string& line) {
    fmt::print("{}", line);
    std::fflush(stdout);
  };
  PlcTrouble trouble;
  tell(fmt::format("accepted as command {}\n", cmd_seq));
  switch (order.command) {
    case PlcCommand::slab_begin:
      if (!plc.await_status(cmd_seq, CommandStatus::done, traits.result_timeout, trouble)) stop_with(trouble);
      tell(fmt::format("slab {} is open, type {}\n", plc.seen().slab_no, plc.seen().slab_type));
      return Verdict::none;
    case PlcCommand::slab_abort:
      if (!plc.await([&] { return !plc.seen().slab_open; }, traits.result_timeout, "the slab to be aborted", trouble))
        stop_with(trouble);
      break;
    case PlcCommand::scan:
      if (!plc.await_status(cmd_seq, CommandStatus::acquired, traits.acquire_timeout, trouble)) stop_with(trouble);
      tell(fmt::format("ACQUIRED after {:.1f} s; the robot may leave\n", since()));
      break;
    default: break;
  }
  const int kind = order.command == PlcCommand::scan ? 1 : 2;
  const auto arrived = [&] { return plc.result(order.slab_no, kind, order.station, cmd_seq) != nullptr; };
  if (!plc.await(arrived, traits.result_timeout, "the result", trouble)) stop_with(trouble);
  const PlcResult& record = plc.result(order.slab_no, kind, order.station, cmd_seq)->record;
  tell(fmt::format("result after {:.1f} s\n", since()));
  return record.verdict;
}

int give(const Options& options) {
  const PlcCommand command = command_named(options.word);
  if (command == PlcCommand::none)
    stop(kUsage, fmt::format("COMMAND: found '{}', allowed is SLAB_BEGIN, SCAN, SLAB_END or SLAB_ABORT", options.word));
  if ((command == PlcCommand::scan) != (options.station != 0))
    stop(kUsage, command == PlcCommand::scan ? "SCAN needs the station, such as SCAN 3" : "only SCAN has a station");
  config::Config config;
  if (!config_from(options.config, config)) return kBadInput;
  if (options.slab_id.size() > PlcInputs{}.slab_id.size())
    stop(kUsage,
         fmt::format("--slab-id: found {} bytes, allowed are {}", options.slab_id.size(), PlcInputs{}.slab_id.size()));
  if ((config.plc.role == hal::PlcRole::rtu) == options.device.empty())
    stop(kUsage, config.plc.role == hal::PlcRole::rtu
                     ? "--device: with [plc] role = \"rtu\" name the PLC's end of the serial line"
                     : "--device is for [plc] role = \"rtu\"");
  struct sigaction action = {};
  action.sa_handler = [](int) { g_interrupted = true; };
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);

  const PlcOrder order = order_of(options, command, wait_for_control(config, options.take_results));
  PlcTraits traits;
  traits.plc = config.plc;
  traits.device = options.device;
  const std::unique_ptr<PlcPeer> plc = need(PlcPeer::connect(traits, g_interrupted));
  // However it ends, results that were acknowledged are printed, and ENABLE is cleared.
  Verdict verdict = Verdict::none;
  std::optional<Stop> stopped;
  try {
    PlcTrouble trouble;
    std::uint16_t cmd_seq = 0;
    PlcClock::time_point written;
    if (!plc->issue(order, cmd_seq, trouble, &written)) stop_with(trouble);
    verdict = follow(*plc, order, cmd_seq, written, traits);
  } catch (const Stop& end) {
    stopped = end;
  }
  // slabd takes an acknowledgement with its next look at the PLC; until then the result still waits.
  if (PlcTrouble ignored; !plc->results().empty())
    (void)plc->await([&] { return !plc->seen().result && plc->seen().results_pending == 0; }, kAcknowledged,
                     "the acknowledgement to be taken", ignored);
  for (const StoredResult& stored : plc->results()) fmt::print("{}", result_line(stored.record));
  plc->disable();
  if (stopped) throw *stopped;
  return verdict == Verdict::none || verdict == Verdict::pass || command == PlcCommand::slab_abort ? kDone : kNotPass;
}

}  // namespace

void add_plc_command(args::Command& plc) {
  auto options = std::make_shared<Options>();
  args::Command command =
      plc.add_subcommand("command", "One command of the PLC by hand, for commissioning; refused while a PLC commands");
  command->footer(
      "\nTakes the PLC's place for this command: a new SESSION, ENABLE, a heartbeat, the command, its answer and its\n"
      "result, then ENABLE off. The robot has to stand over the block before SCAN.\nExit status 1 when the verdict is "
      "not pass, 6 when slabd or this command refuses.\nExamples:\n"
      "  slabctl plc command SLAB_BEGIN --slab-no 1 --slab-type 5600\n"
      "  slabctl plc command SCAN 3\n"
      "  slabctl plc command SLAB_END");
  command->add_option("COMMAND", options->word, "SLAB_BEGIN, SCAN, SLAB_END or SLAB_ABORT")->required();
  command->add_option("STATION", options->station, "SCAN: the block")
      ->check(args::range(1, static_cast<int>(limits::kStationsMax)));
  command->add_option("--config", options->config, "The daemon's configuration")->default_val(default_config());
  command->add_option("--slab-no", options->slab_no, "SLAB_BEGIN: number of the slab")
      ->check(args::range(std::int64_t{1}, std::int64_t{4'294'967'295}));
  command->add_option("--slab-type", options->slab_type, "SLAB_BEGIN: type of the slab")->check(args::range(1, 65'535));
  command->add_option("--slab-id", options->slab_id, "SLAB_BEGIN: id of the slab");
  command->add_option("--second-chip", options->second_chip,
                      "SLAB_BEGIN: id in the slab's second chip; refused with 108 if it is another one");
  command->add_option("--mould", options->mould, "SLAB_BEGIN: number of the mould (default: 0, unknown)")
      ->check(args::range(1, 65'535));
  command->add_option("--device", options->device, "[plc] role \"rtu\": the PLC's end of the serial line");
  command->add_flag("--take-results", options->take_results,
                    "Also fetch and acknowledge results that wait for the PLC, which then never receives them");
  command->runs([options] { return give(*options); });
}

}  // namespace slabd::cli
