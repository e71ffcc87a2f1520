// SPDX-License-Identifier: Apache-2.0
#include "cli/db/care_answer.h"

#include <nlohmann/json.hpp>

namespace slabd::cli {
namespace {

CareAnswer::Work work_of(const nlohmann::json& all, const char* name, const char* count) {
  CareAnswer::Work work;
  const nlohmann::json& j = all.at(name);
  work.state = j.value("state", "");
  work.path = j.value("path", "");
  work.done = j.value(count, std::int64_t{0});
  work.error = j.value("error", "");
  return work;
}

}  // namespace

Result<CareAnswer> parse_care(const std::string& line) {
  try {
    const nlohmann::json j = nlohmann::json::parse(line);
    if (j.contains("error")) return error(Code::config, "slabd refused: %s", j.value("error", "").c_str());
    return CareAnswer{work_of(j, "backup", "pages"), work_of(j, "prune", "slabs")};
  } catch (const nlohmann::json::exception&) {
    return error(Code::scanner_offline, "slabd gave an answer that is none: is it older than slabctl?");
  }
}

}  // namespace slabd::cli
