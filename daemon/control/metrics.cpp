// SPDX-License-Identifier: Apache-2.0
//
// The daemon's metrics in the text format of Prometheus. Names and meanings are in one list; counters count from the
// start of the process, maxima since the start or the last reset. Control path: uses the heap.
#include <malloc.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "daemon/log_outlet.h"
#include "daemon/loop.h"
#include "daemon/station/parts.h"
#include "storage/chain.h"

namespace slabd::daemon {
namespace {

class Text {
 public:
  void gauge(const char* name, const char* help, double value) { metric("gauge", name, help, "", value); }
  void counter(const char* name, const char* help, std::uint64_t value) {
    metric("counter", name, help, "", static_cast<double>(value));
  }
  void labelled(const char* name, const char* help, const std::string& label, double value) {
    metric("gauge", name, help, "{" + label + "}", value);
  }
  /// One metric with several labels; the help text is written at the first use of its name.
  void counter_of(const char* name, const char* help, std::string_view what, std::uint64_t value) {
    metric("counter", name, help, "{what=\"" + std::string(what) + "\"}", static_cast<double>(value));
  }
  /// One series of each arm: that of arm 0 has no further label, the others that of their scanner. `value(arm)`.
  template <typename Value>
  void of_arms(const char* type, const char* name, const char* help, const LineArms& arms, const std::string& label,
               const Value& value) {
    for (std::size_t i = 0; i < arms.list.size(); ++i) {
      std::string labels = label;
      if (i > 0) labels += std::string(labels.empty() ? "" : ",") + "scanner=\"" + arms.list[i].scanner.c_str() + "\"";
      metric(type, name, help, labels.empty() ? "" : "{" + labels + "}", static_cast<double>(value(i)));
    }
  }
  [[nodiscard]] std::string take() { return std::move(text_); }

 private:
  void metric(const char* type, const char* name, const char* help, const std::string& labels, double value) {
    if (last_ != name) {
      text_ += std::string("# HELP ") + name + " " + help + "\n# TYPE " + name + " " + type + "\n";
      last_ = name;
    }
    char number[40];
    std::snprintf(number, sizeof number, "%.17g", value);
    text_ += name + labels + " " + number + "\n";
  }

  std::string text_;
  std::string last_;
};

/// Size of the file; 0 if it does not exist.
double file_bytes(const std::string& path) {
  std::error_code ec;
  const std::uintmax_t bytes = std::filesystem::file_size(path, ec);
  return ec ? 0.0 : static_cast<double>(bytes);
}

/// A label's value: backslash, quote and line end are escaped, characters outside plain ASCII become '?'.
std::string label_value(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c == '\\' || c == '"') out += '\\';
    out += c >= ' ' && c <= '~' ? c : '?';
  }
  return out;
}

/// The first 48 bits of the checksum, which a double represents exactly. A label with the whole checksum would make a
/// new series for every slab.
double head_number(const storage::ChainHead& head) {
  constexpr std::size_t kHexDigits = 12;
  const std::string digits(head.sha256.view().substr(0, kHexDigits));
  return static_cast<double>(std::strtoull(digits.c_str(), nullptr, 16));
}

void tell_plc(Text& text, const hal::PlcPort& plc, bool alive) {
  text.gauge("slabd_plc_alive", "1: the PLC's heartbeat changes", alive ? 1 : 0);
  text.gauge("slabd_plc_connections", "Modbus connections now open", static_cast<double>(plc.clients()));
  const auto put = [&](std::string_view what, std::uint64_t value) {
    text.counter_of("slabd_plc_events_total", "Events on the way to the PLC", what, value);
  };
  fields(put, plc.counters());
}

void tell_pose(Text& text, const Station& station, const Ports& ports, const LoopFigures& figures) {
  const LineArms& arms = station.settings.arms;
  text.of_arms("gauge", "slabd_pose_ok", "1: fresh robot poses arrive", arms, "",
               [&](std::size_t arm) { return station.arms[arm].gate.link(station.now_ns) == Code::ok ? 1 : 0; });
  const auto datagrams = [&](const char* what, std::uint64_t hal::PoseLinkCounters::*counter) {
    text.of_arms("counter", "slabd_pose_datagrams_total", "Datagrams on the way from the robot", arms,
                 std::string("what=\"") + what + "\"",
                 [&](std::size_t arm) { return ports.pose_of(arm).counters().*counter; });
  };
  using Counters = hal::PoseLinkCounters;
  datagrams("accepted", &Counters::accepted);
  datagrams("foreign", &Counters::foreign);
  datagrams("other_type", &Counters::other_type);
  datagrams("wrong_sender", &Counters::wrong_sender);
  datagrams("not_finite", &Counters::not_finite);
  datagrams("not_unit", &Counters::not_unit);
  datagrams("out_of_reach", &Counters::out_of_reach);
  datagrams("second_publisher", &Counters::second_publisher);
  datagrams("repeated", &Counters::repeated);
  datagrams("time_back", &Counters::time_back);
  datagrams("time_unit", &Counters::time_unit);
  datagrams("jump", &Counters::jumps);
  text.of_arms("counter", "slabd_pose_gaps_total", "Breaks in the numbering of the robot's poses", arms, "",
               [&](std::size_t arm) { return ports.pose_of(arm).counters().gaps; });
  text.of_arms("counter", "slabd_pose_lost_total", "Poses missing in those breaks", arms, "",
               [&](std::size_t arm) { return ports.pose_of(arm).counters().lost; });
  text.of_arms("counter", "slabd_pose_stale_total", "Times that the newest pose became too old", arms, "",
               [&](std::size_t arm) { return figures.poses[arm].stale; });
  text.of_arms("counter", "slabd_pose_wrong_frame_total", "Times that another base or tool became active", arms, "",
               [&](std::size_t arm) { return figures.poses[arm].wrong_frame; });
}

void tell_scanners(Text& text, const Station& station, const Ports& ports) {
  const LineArms& arms = station.settings.arms;
  text.of_arms("gauge", "slabd_scanner_online", "1: the scanner is available", arms, "",
               [&](std::size_t arm) { return station.arms[arm].links.scanner_online ? 1 : 0; });
  text.of_arms("counter", "slabd_scan_strays_total", "Files that answered no request", arms, "",
               [&](std::size_t arm) { return station.arms[arm].links.stray_files; });
  text.of_arms("counter", "slabd_scan_strays_deleted_total", "Stray scans deleted again because stray/ was full", arms,
               "", [&](std::size_t arm) { return ports.scanner_of(arm).deleted().files; });
  text.of_arms("counter", "slabd_scan_strays_deleted_bytes_total", "Their bytes", arms, "",
               [&](std::size_t arm) { return ports.scanner_of(arm).deleted().bytes; });
  text.of_arms("gauge", "slabd_scanner_hangs",
               "1: the scanner's drop folder, or the disk of the scans, does not answer", arms, "",
               [&](std::size_t arm) { return ports.scanner_of(arm).hangs() ? 1 : 0; });
  if (!arms.several()) return;
  const TieFault fault = fault_of_tie(station.calibration, arms.list[1].robot, expiry_utime_us(station));
  text.gauge("slabd_tie_ok", "1: the tie of the two robots can be used", fault == TieFault::none ? 1 : 0);
}

/// Times until the master checks are due. A gauge that was never checked is only in slabd_gauges_need_care.
void tell_gauges(Text& text, const Station& s) {
  if (s.settings.gauges.empty()) return;
  text.gauge("slabd_gauges_need_care", "1: a gauge is stuck, or its master check is missing, failed or overdue",
             gauges_need_care(s) ? 1 : 0);
  for (std::size_t i = 0; i < s.settings.gauges.size(); ++i) {
    const GaugeSettings& gauge = s.settings.gauges[i];
    const GaugeCheck& check = s.gauges.checks[i];
    if (!gauge.master.given || check.utime_us == 0) continue;
    text.labelled("slabd_gauge_check_due_seconds", "Until a gauge's master check is due; negative: overdue",
                  "gauge=\"" + label_value(gauge.name.view()) + "\"",
                  static_cast<double>(check.utime_us + gauge.master.every_us - expiry_utime_us(s)) / 1e6);
  }
}

}  // namespace

std::string metrics_text(const Station& station, const Ports& ports, const LoopFigures& figures) {
  const PlcOutputs view = plc_view(station);
  Text text;
  text.labelled("slabd_info", "Always 1; which software this is",
                "software=\"" + label_value(station.settings.software.view()) + "\"", 1);
  text.gauge("slabd_uptime_seconds", "Since the start of the process",
             static_cast<double>(station.now_ns - figures.started_ns) / 1e9);
  text.gauge("slabd_state", "STATE as the PLC reads it: 2 idle, 7 fault, 8 maintenance",
             static_cast<double>(view.state));
  text.gauge("slabd_fault_code", "FAULT as the PLC reads it; 0: none", view.fault);
  text.gauge("slabd_warn_mask", "WARN as the PLC reads it", view.warn);
  text.gauge("slabd_emulated", "1: STATUS bit 11: robot, scanner or the slab that is shown is not real",
             view.simulation ? 1 : 0);
  text.gauge("slabd_session", "SESSION; a change without a reason is a restart", view.session);
  text.gauge("slabd_slab_open", "1: a slab is open", station.slab.phase != SlabPhase::none ? 1 : 0);
  text.gauge("slabd_stations_done", "Stations measured of the open slab", view.stations_done);
  text.gauge("slabd_results_pending", "Results that wait for RES_ACK", view.results_pending);
  text.counter("slabd_commands_refused_total", "Commands refused or repeated", view.refused);
  tell_plc(text, ports.plc, view.plc_link_ok);
  tell_pose(text, station, ports, figures);
  tell_scanners(text, station, ports);
  tell_gauges(text, station);
  text.gauge("slabd_store_ok", "1: the database can be written", view.store_ok ? 1 : 0);
  text.gauge("slabd_database_bytes", "Size of the database's file", file_bytes(figures.db_path));
  text.gauge("slabd_database_log_bytes", "Size of its write-ahead log; it grows while a reader stays open",
             file_bytes(figures.db_path + "-wal"));
  const storage::ChainHead head = ports.store == nullptr ? storage::ChainHead{} : storage::chain_head(*ports.store);
  text.gauge("slabd_chain_entries", "Length of the chain of results", static_cast<double>(head.entries));
  text.gauge("slabd_chain_head", "First 48 bits of the SHA-256 of its newest entry, as a number", head_number(head));
  if (ports.store != nullptr && !figures.plant_line.empty()) {
    const storage::Backlog behind = ports.store->care().backlog;
    text.gauge("slabd_plant_unsent", "Rows of the outbox that the plant's database does not have yet",
               static_cast<double>(behind.newest_seq - behind.sent_seq));
    text.gauge("slabd_plant_unsent_seconds", "Age of the oldest of them", plant_age_s(behind, station.utime_us));
  }
  text.gauge("slabd_commit_last_seconds", "The last commit", figures.commit_last_ms / 1e3);
  text.gauge("slabd_commit_max_seconds", "The longest commit since the last reset", figures.commit_max_ms / 1e3);
  text.counter("slabd_blocks_measured_total", "Blocks measured", figures.blocks_measured);
  text.gauge("slabd_block_last_seconds", "The last block, read to verdict", figures.block_last_ms / 1e3);
  text.gauge("slabd_block_max_seconds", "The longest block since the last reset", figures.block_max_ms / 1e3);
  text.counter("slabd_log_lines_lost_total", "Lines that neither the journal nor stderr accepted", log_lines_lost());
  text.gauge("slabd_memory_bytes", "Resident memory", 1024.0 * static_cast<double>(memory_kb("VmRSS")));
  text.gauge("slabd_memory_max_bytes", "The most there ever was", 1024.0 * static_cast<double>(memory_kb("VmHWM")));
  text.gauge("slabd_memory_locked_bytes", "Cannot be swapped out; all of it with --seal",
             1024.0 * static_cast<double>(memory_kb("VmLck")));
  text.gauge("slabd_memory_mapped_bytes", "Addresses in use", 1024.0 * static_cast<double>(memory_kb("VmSize")));
  text.gauge("slabd_heap_bytes", "Allocated bytes of the C library's heap",
             static_cast<double>(::mallinfo2().uordblks));
  return text.take();
}

}  // namespace slabd::daemon
