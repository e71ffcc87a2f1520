// SPDX-License-Identifier: Apache-2.0
//
// The verbs "care", "backup" and "prune" of the control socket: what the database as a whole is asked for. The storage
// thread does the work between its jobs; here orders go in and their state comes out.
#include <array>
#include <nlohmann/json.hpp>

#include "daemon/loop.h"

namespace slabd::daemon {
namespace {

using Json = nlohmann::ordered_json;

const char* phase_name(storage::CareState::Phase phase) {
  static constexpr std::array kNames = {"none", "under_way", "done", "failed"};
  return kNames.at(static_cast<std::size_t>(phase));
}

}  // namespace

std::string care_json(const storage::Store& store) {
  const storage::CareState care = store.care();
  Json j;
  j["schema"] = "slabd.care/1";
  j["backup"] = {{"state", phase_name(care.backup)},
                 {"path", care.backup_path},
                 {"pages", care.backup_pages},
                 {"pages_all", care.backup_pages_all},
                 {"error", care.backup_error}};
  j["prune"] = {{"state", phase_name(care.prune)}, {"slabs", care.pruned_slabs}, {"error", care.prune_error}};
  return j.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

Status order_care(std::string_view line, storage::Store& store, const std::string& db_path, std::int64_t utime_us) {
  const Json request = Json::parse(line, nullptr, false);
  if (!request.is_object()) return error(Code::config, "a request is one JSON object");
  if (request.value("verb", "") == "backup") {
    const Result<std::string> path = storage::backup_path(db_path, utime_us);
    if (!path.ok()) return path.error();
    return store.order(storage::BackupOrder{path.value()});
  }
  const auto keep = request.find("keep_slabs");
  if (keep == request.end() || !keep->is_number_integer())
    return error(Code::config, "\"keep_slabs\" must be a whole number");
  storage::PruneOrder order{keep->get<std::int64_t>()};
  if (const auto failed = request.find("keep_failed_slabs"); failed != request.end()) {
    if (!failed->is_number_integer()) return error(Code::config, "\"keep_failed_slabs\" must be a whole number");
    order.keep_failed_slabs = failed->get<std::int64_t>();
  }
  return store.order(order);
}

}  // namespace slabd::daemon
