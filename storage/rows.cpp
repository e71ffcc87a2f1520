// SPDX-License-Identifier: Apache-2.0
#include "storage/rows.h"

#include <algorithm>

namespace slabd::storage {
namespace {

constexpr std::array<std::string_view, 5> kPhases = {"empty", "acquiring", "acquired", "measured", "failed"};
constexpr std::array<std::string_view, 4> kScanStates = {"none", "kept", "deleting", "deleted"};

/// The value below `count` whose word this is.
template <typename E>
bool search(std::string_view text, std::size_t count, E& out) {
  for (std::size_t i = 0; i < count; ++i) {
    if (word(static_cast<E>(i)) != text) continue;
    out = static_cast<E>(i);
    return true;
  }
  return false;
}

}  // namespace

std::string_view word(Verdict verdict) {
  return name(verdict);
}
std::string_view word(RegistrationStatus status) {
  return name(status);
}
std::string_view word(ItemId id) {
  return info(id).name;
}
std::string_view word(StationPhase phase) {
  return kPhases.at(static_cast<std::size_t>(phase));
}
std::string_view word(ScanState state) {
  return kScanStates.at(static_cast<std::size_t>(state));
}
std::string_view word(SpliceSource source) {
  return name(source);
}
std::string_view word(CalibrationKind kind) {
  return name(kind);
}
std::string_view word(PlaneDoubt doubt) {
  return name(doubt);
}
std::string_view word(CasingDoubt doubt) {
  return name(doubt);
}
std::string_view word(FindingKind kind) {
  return name(kind);
}
std::string_view word(FindingFace face) {
  return name(face);
}
std::string_view word(EdgeFace face) {
  return name(face);
}

bool from_word(std::string_view text, Verdict& out) {
  return search(text, 6, out);
}
bool from_word(std::string_view text, RegistrationStatus& out) {
  return search(text, 5, out);
}
bool from_word(std::string_view text, ItemId& out) {
  return search(text, kItemCount, out);
}
bool from_word(std::string_view text, StationPhase& out) {
  return search(text, kPhases.size(), out);
}
bool from_word(std::string_view text, ScanState& out) {
  return search(text, kScanStates.size(), out);
}
bool from_word(std::string_view text, SpliceSource& out) {
  return search(text, kSpliceSources, out);
}
bool from_word(std::string_view text, CalibrationKind& out) {
  return search(text, kCalibrationKinds, out);
}
bool from_word(std::string_view text, PlaneDoubt& out) {
  return search(text, kPlaneDoubts, out);
}
bool from_word(std::string_view text, CasingDoubt& out) {
  return search(text, kCasingDoubts, out);
}
bool from_word(std::string_view text, FindingKind& out) {
  return search(text, kFindingKinds, out);
}
bool from_word(std::string_view text, FindingFace& out) {
  return search(text, kFindingFaces, out);
}
bool from_word(std::string_view text, EdgeFace& out) {
  return search(text, kEdgeFaces, out);
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
