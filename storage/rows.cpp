// SPDX-License-Identifier: Apache-2.0
#include "storage/rows.h"

#include <algorithm>

namespace slabd::storage {
namespace {

constexpr std::array<std::string_view, kValues<StationPhase>> kPhases = {"empty", "acquiring", "acquired", "measured",
                                                                         "failed"};
constexpr std::array<std::string_view, kValues<ScanState>> kScanStates = {"none", "kept", "deleting", "deleted"};

}  // namespace

std::string_view word(ItemId id) {
  return info(id).name;
}
std::string_view word(StationPhase phase) {
  return kPhases.at(static_cast<std::size_t>(phase));
}
std::string_view word(ScanState state) {
  return kScanStates.at(static_cast<std::size_t>(state));
}

std::string joined(const std::vector<std::string>& names, std::string_view separator) {
  std::string text;
  for (const std::string& name : names) {
    if (!text.empty()) text += separator;
    text += name;
  }
  return text;
}

std::string insert_text(std::string_view table, const std::vector<std::string>& names) {
  std::vector<std::string> parameters;
  for (std::size_t i = 1; i <= names.size(); ++i) parameters.push_back("?" + std::to_string(i));
  return "INSERT INTO " + std::string(table) + " (" + joined(names, ", ") + ") VALUES (" + joined(parameters, ", ") +
         ")";
}

std::string upsert_text(std::string_view table, const std::vector<std::string>& names,
                        const std::vector<std::string>& key) {
  std::vector<std::string> updates;
  for (const std::string& name : names)
    if (std::find(key.begin(), key.end(), name) == key.end()) updates.push_back(name + " = excluded." + name);
  return insert_text(table, names) + " ON CONFLICT (" + joined(key, ", ") + ") DO UPDATE SET " + joined(updates, ", ");
}

}  // namespace slabd::storage
