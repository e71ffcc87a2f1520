// SPDX-License-Identifier: Apache-2.0
//
// Problem: thousands of slabs are measured again for days of computing, by processes that can be killed, started twice
// or left running on a machine that is taken for dead. Idea: one file a slab, whose name contains all inputs, and which
// appears complete by rename. Existing files are not measured again, so that a shard can be started at any time.
//
// Invariant: merge_shards prints nothing unless every selected slab has its file, from the inputs of the selection.
#include "cli/replay/shard.h"

#include <fmt/core.h>
#include <linux/ioprio.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/durable.h"
#include "calib/calib.h"
#include "cli/client/control.h"
#include "cli/exit.h"
#include "daemon/measure.h"
#include "hal/system/control_client.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

bool daemon_listens(const std::string& socket) {
  constexpr int kAnswerTimeout_ms = 3'000;
  const int fault = hal::try_control(socket, kAnswerTimeout_ms, nullptr);
  return fault == 0 || fault == EAGAIN || fault == EACCES;
}

/// Stops if a slab is open on the line of this machine. Without a running daemon this machine has no line.
void stop_beside_open_slab(const std::string& socket) {
  constexpr const char* kCure = "; finished slabs are kept, start the shard again later, or use --beside-the-line";
  if (socket.empty() || !daemon_listens(socket)) return;
  const Result<std::string> answer = ask_daemon(socket, "{\"verb\":\"status\"}\n");
  if (!answer)
    stop(kNotReachable, fmt::format("a slab may be open on this line: {}{}", answer.error().text.view(), kCure));
  const nlohmann::json status = nlohmann::json::parse(answer.value(), nullptr, false);
  if (!status.is_object() || !status.contains("slab"))
    stop(kNotReachable, fmt::format("a slab may be open on this line: {} answers without a status{}", socket, kCure));
  const nlohmann::json& slab = status["slab"];
  if (slab.is_null()) return;
  const std::string id = slab.is_object() && slab.contains("id") ? slab["id"].dump() : "";
  stop(kNotReachable, fmt::format("slab {} is open on this line{}", id, kCure));
}

std::string path_in(const std::string& dir, const std::string& file) {
  return (fs::path(dir) / file).string();
}

/// Writes the selection's file unless it exists. Stops if the folder has the file of another selection.
void join_selection(const std::string& dir, const Selection& selection) {
  std::error_code fault;
  fs::create_directories(dir, fault);
  if (fault) stop(kBadInput, fmt::format("{}: the folder cannot be made: {}", dir, fault.message()));
  const std::string own = selection.file_name();
  for (const std::string& file : shard_folder(dir).selections) {
    if (file == own) continue;
    Selection other;
    const std::string damage = read_selection(path_in(dir, file), other);
    if (!damage.empty()) stop(kBadInput, damage);
    stop(
        kBadInput,
        fmt::format("{} has the results of another replay, name another folder: {} differs from this command in {}. If "
                    "only the slabs differ, use a backup of the database, or --until",
                    dir, file, difference(other, selection)));
  }
  Selection same;
  const std::string path = path_in(dir, own);
  if (fs::exists(path, fault) && read_selection(path, same).empty()) return;
  need(write_durably(path, selection.text()));
}

/// True if the file of the slab exists and is intact; `out` has its content.
bool is_done(const std::string& path, const std::string& slab_sha256, SlabFile& out) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) return false;
  const std::string damage = read_slab_file(path, out);
  if (damage.empty() && out.inputs_sha256 == slab_sha256) return true;
  complain(fmt::format("{}; the slab is measured again",
                       damage.empty() ? path + ": its content is that of other inputs" : damage));
  return false;
}

std::string shard_text(const ReplayHead& head, const ReplayCount& count) {
  return head.kind == ReplayKind::verify ? count.verified_text()
                                         : fmt::format("judged {}, left out {}", count.judged, count.left_out);
}

}  // namespace

bool Shard::contains(std::int64_t key) const {
  constexpr std::size_t kDigits = 15;  // 60 bits
  const std::string digits = calib::sha256_hex(fmt::format("{}", key)).substr(0, kDigits);
  std::uint64_t number = 0;
  std::from_chars(digits.data(), digits.data() + digits.size(), number, 16);
  return number % static_cast<std::uint64_t>(count) == static_cast<std::uint64_t>(index - 1);
}

std::optional<Shard> parse_shard(std::string_view text) {
  Shard shard;
  const std::size_t slash = text.find('/');
  if (slash == std::string_view::npos) return std::nullopt;
  const auto number = [](std::string_view digits, int& out) {
    const bool whole = !digits.empty() && digits.find_first_not_of("0123456789") == std::string_view::npos;
    return whole && std::from_chars(digits.data(), digits.data() + digits.size(), out).ec == std::errc{};
  };
  if (!number(text.substr(0, slash), shard.index) || !number(text.substr(slash + 1), shard.count)) return std::nullopt;
  if (shard.index < 1 || shard.index > shard.count || shard.count > kShardsMax) return std::nullopt;
  return shard;
}

void give_way_to_line(const std::string& control_socket) {
  constexpr int kNice = 10;
  if (!daemon_listens(control_socket)) return;
  errno = 0;
  const int now = ::getpriority(PRIO_PROCESS, 0);
  if (errno == 0 && now < kNice) ::setpriority(PRIO_PROCESS, 0, kNice);
  ::syscall(SYS_ioprio_set, IOPRIO_WHO_PROCESS, 0, IOPRIO_PRIO_VALUE(IOPRIO_CLASS_IDLE, 0));
}

std::string build_sha256() {
  const FixedString<64> software = daemon::software_version();
  const std::string_view version = software.view();
  if (!version.ends_with(".dirty") && !version.ends_with("unknown")) return "";
  return need(digest_of("/proc/self/exe"), kInternal).sha256;
}

int run_shard(const ShardRun& run, const Selection& selection, const ReplayHead& head,
              const std::function<ReplayRecord(std::int64_t)>& measure) {
  join_selection(run.out, selection);
  const std::string inputs = selection.inputs_sha256();
  ReplayCount count;
  int slabs = 0;
  int measured = 0;
  for (const SelectedSlab& slab : selection.slabs) {
    if (!run.shard.contains(slab.key)) continue;
    ++slabs;
    SlabFile file;
    const std::string sha256 = slab_inputs_sha256(inputs, slab);
    const std::string path = path_in(run.out, slab_file_name(slab.key, sha256));
    if (!is_done(path, sha256, file)) {
      stop_beside_open_slab(run.control_socket);
      file = {head.software, selection.inputs.build, sha256, head.instruction_set, slab.key, measure(slab.key)};
      const std::string text = file.text();
      // report::Json replaces bytes that are not UTF-8, so that the merge would not print the same.
      if (text.find("\\ufffd") != std::string::npos)
        stop(kBadInput, fmt::format("slab {}: a path is not UTF-8; a shard's file cannot contain it", slab.key));
      need(write_durably(path, text));
      ++measured;
    }
    count.add(file.record);
  }
  fmt::print("shard {}/{}: {} of {} slabs, {} measured now, {} done before; {}\n", run.shard.index, run.shard.count,
             slabs, selection.slabs.size(), measured, slabs - measured, shard_text(head, count));
  return slabs == 0 ? static_cast<int>(kDone) : count.status(head);
}

}  // namespace slabd::cli
