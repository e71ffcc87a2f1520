// SPDX-License-Identifier: Apache-2.0
#include "cli/replay/shard_files.h"

#include <fmt/core.h>

#include <algorithm>
#include <concepts>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <regex>
#include <string_view>
#include <type_traits>

#include "calib/calib.h"
#include "cli/exit.h"
#include "cli/terminal/parse.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::string_view kSelectionSchema = "slabd.replay_selection/1";
constexpr std::string_view kSlabSchema = "slabd.replay_shard/1";
/// Digits of a SHA-256 in a file name.
constexpr std::size_t kNameDigits = 16;

// ---- writing -------------------------------------------------------------------------------------------------------

constexpr std::string_view kEnd = "\n}\n";
constexpr std::string_view kSum = ",\n  \"sha256\": \"";
constexpr std::string_view kEndAfterSum = "\"\n}\n";

/// The document with a last field, the SHA-256 of the bytes in front of it.
std::string with_checksum(const report::Json& document) {
  std::string text = document.text();
  text.resize(text.size() - kEnd.size());
  const std::string sum = calib::sha256_hex(text);
  return text.append(kSum).append(sum).append(kEndAfterSum);
}

// ---- reading -------------------------------------------------------------------------------------------------------

/// True for a record with a list of its fields (base/fields.h).
struct AnyField {
  template <typename T>
  void operator()(std::string_view name, T& out);
};
template <typename T>
concept Record = requires(AnyField& field, T& record) {
  fields(field, record);
};

/// Reads a value that report::Json wrote. Throws an exception of nlohmann or std if it is of another type.
template <typename T>
void read(const json& from, T& out) {
  if constexpr (std::same_as<T, std::string> || std::same_as<T, bool> || std::integral<T>) {
    from.get_to(out);
  } else if constexpr (Record<T>) {
    const auto field = [&from](std::string_view name, auto& member) { read(from.at(std::string(name)), member); };
    fields(field, out);
  } else {
    for (const json& element : from.get_ref<const json::array_t&>()) read(element, out.emplace_back());
  }
}

template <typename T>
T value(const json& from, const char* key) {
  T out{};
  read(from.at(key), out);
  return out;
}

Verdict verdict_at(const json& from, const char* key) {
  const auto word = value<std::string>(from, key);
  return word == name(Verdict::none) ? Verdict::none : verdict_from_name(word).value();
}

ReplayOutcome outcome_at(const json& from) {
  const auto word = value<std::string>(from, "outcome");
  for (const ReplayOutcome outcome : {ReplayOutcome::identical, ReplayOutcome::differs, ReplayOutcome::not_verified})
    if (word == name(outcome)) return outcome;
  throw std::out_of_range("outcome");
}

std::optional<std::uint32_t> crc32c_at(const json& from, const char* key) {
  if (from.at(key).is_null()) return std::nullopt;
  return static_cast<std::uint32_t>(std::stoul(value<std::string>(from, key), nullptr, 16));
}

double number_at(const json& from, const char* key) {
  const json& number = from.at(key);
  return number.is_null() ? kNoValue : number.get<double>();
}

SlabReplay verified_slab(const json& document) {
  const json& from = document.at("verify");
  SlabReplay slab;
  slab.key = value<std::int64_t>(from, "key");
  slab.slab_id = value<std::string>(from, "slab_id");
  slab.recorded_recipe = value<std::string>(document, "recorded_recipe");
  slab.verdict = verdict_at(from, "verdict");
  slab.outcome = outcome_at(from);
  slab.recipe = value<std::string>(from, "recipe");
  slab.scans_left = value<bool>(document, "scans_left");
  read(from.at("changed"), slab.changed);
  for (const json& each : from.at("blocks").get_ref<const json::array_t&>()) {
    BlockReplay& block = slab.blocks.emplace_back();
    block.station = value<int>(each, "station");
    block.attempt = value<int>(each, "attempt");
    block.scan = value<std::string>(each, "scan");
    block.crc32c_stored = crc32c_at(each, "crc32c_stored");
    block.crc32c_now = crc32c_at(each, "crc32c_now");
    block.outcome = outcome_at(each);
    block.why = value<std::string>(each, "why");
    read(each, block.comparison);
  }
  slab.slab_compared = value<bool>(from.at("slab"), "compared");
  slab.slab_why = value<std::string>(from.at("slab"), "why");
  read(from.at("slab"), slab.slab);
  return slab;
}

Item item_at(const json& from, const char* key, Item item) {
  const json& figures = from.at(key);
  item.value = number_at(figures, "value");
  item.U = number_at(figures, "U");
  item.lower = number_at(figures, "lower");
  item.upper = number_at(figures, "upper");
  item.verdict = verdict_at(figures, "verdict");
  return item;
}

WhatIfSlab what_if_slab(const json& from) {
  WhatIfSlab slab;
  slab.left_out = value<std::string>(from, "left_out");
  const json& of_slab = from.at("slab");
  slab.key = value<std::int64_t>(of_slab, "key");
  slab.slab_id = value<std::string>(of_slab, "slab_id");
  slab.stored = verdict_at(of_slab, "stored");
  slab.now = verdict_at(of_slab, "now");
  for (const json& each : of_slab.at("items").get_ref<const json::array_t&>()) {
    Item item;
    item.id = item_from_name(value<std::string>(each, "id")).value();
    item.station = value<std::uint8_t>(each, "station");
    item.station_to = value<std::uint8_t>(each, "station_to");
    slab.changed.push_back({item_at(each, "stored", item), item_at(each, "now", item)});
  }
  for (const json& each : from.at("items").get_ref<const json::array_t&>()) {
    VerdictTally& tally = slab.items[static_cast<std::size_t>(item_from_name(value<std::string>(each, "id")).value())];
    tally.count = value<int>(each, "count");
    for (const json& change : each.at("changes").get_ref<const json::array_t&>())
      tally.changes[{verdict_at(change, "stored"), verdict_at(change, "now")}] = value<int>(change, "count");
  }
  return slab;
}

/// Reads the document, checks its checksum and its schema, and calls `use`. Returns the fault.
template <typename Use>
std::string read_document(const std::string& path, std::string_view schema, const Use& use) {
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  if (!file.is_open() || file.bad()) return fmt::format("{}: cannot be read", path);
  json document;
  try {
    document = json::parse(text);
  } catch (const json::parse_error& fault) {
    return fmt::format("{}: not valid JSON at byte {}: the file was damaged or cut", path, fault.byte);
  }
  const std::size_t at = text.rfind(kSum);
  if (at == std::string::npos ||
      text.substr(at + kSum.size()) != calib::sha256_hex(text.substr(0, at)).append(kEndAfterSum))
    return fmt::format("{}: its last field is not the SHA-256 of its {} bytes: the file was damaged or edited", path,
                       text.size());
  try {
    if (value<std::string>(document, "schema") != schema)
      return fmt::format("{}: {} expected, found {}", path, schema, value<std::string>(document, "schema"));
    use(document);
  } catch (const std::exception& fault) {
    return fmt::format("{}: written by another version of slabctl: {}", path, fault.what());
  }
  return "";
}

/// Writes "name: a, b" of the first field that differs.
struct FieldsOf {
  std::vector<std::pair<std::string, std::string>> texts;
  template <typename T>
  void operator()(std::string_view name, const T& member) {
    if constexpr (std::same_as<T, std::string>) {
      texts.emplace_back(name, member);
    } else if constexpr (std::integral<T>) {
      texts.emplace_back(name, fmt::format("{}", member));
    } else if constexpr (std::same_as<T, RecipeName>) {
      texts.emplace_back(name, member.file.empty() ? "" : fmt::format("{} (sha256 {})", member.file, member.sha256));
    } else {
      std::string list;
      for (const RecipeFile& recipe : member)
        list += fmt::format("{}{} (sha256 {:.16})", list.empty() ? "" : ", ", recipe.file, recipe.sha256);
      texts.emplace_back(name, list);
    }
  }
};

std::string slabs_text(const std::vector<SelectedSlab>& slabs) {
  return slabs.empty() ? "0" : fmt::format("{} from {} to {}", slabs.size(), slabs.front().key, slabs.back().key);
}

}  // namespace

ReplayKind Selection::kind() const {
  return inputs.kind == name(ReplayKind::verify) ? ReplayKind::verify : ReplayKind::what_if;
}

std::string Selection::inputs_sha256() const {
  report::Json json;
  json.value(inputs);
  return calib::sha256_hex(json.text());
}

std::string Selection::text() const {
  report::Json json(kSelectionSchema);
  json.field("inputs", inputs).field("inputs_sha256", inputs_sha256()).field("named", named);
  json.field("total", slabs.size()).field("slabs", slabs);
  return with_checksum(json);
}

std::string Selection::file_name() const {
  return fmt::format("selection-{}.json", calib::sha256_hex(text()).substr(0, kNameDigits));
}

std::string slab_inputs_sha256(const std::string& inputs_sha256, const SelectedSlab& slab) {
  return calib::sha256_hex(fmt::format("{}\n{}\n{}\n", inputs_sha256, slab.key, slab.began_utime_us));
}

std::string slab_file_name(std::int64_t key, const std::string& slab_sha256) {
  return fmt::format("{}-{}.json", key, slab_sha256.substr(0, kNameDigits));
}

std::string difference(const Selection& a, const Selection& b) {
  FieldsOf of_a;
  FieldsOf of_b;
  fields(of_a, a.inputs);
  fields(of_b, b.inputs);
  for (std::size_t i = 0; i < of_a.texts.size(); ++i)
    if (of_a.texts[i] != of_b.texts[i])
      return fmt::format("{}: \"{}\", \"{}\"", of_a.texts[i].first, of_a.texts[i].second, of_b.texts[i].second);
  return a.text() == b.text() ? "" : fmt::format("slabs: {}, {}", slabs_text(a.slabs), slabs_text(b.slabs));
}

std::string SlabFile::text() const {
  report::Json json(kSlabSchema);
  json.field("software", software).field("build", build).field("inputs_sha256", inputs_sha256);
  json.field("instruction_set", instruction_set).field("key", key);
  json.field("recorded_recipe", record.verified ? record.verified->recorded_recipe : "");
  json.field("scans_left", record.verified && record.verified->scans_left);
  json.key("verify");
  if (record.verified)
    write_slab(json, *record.verified);
  else
    json.null();
  json.key("what_if");
  if (record.judged)
    write_slab(json, *record.judged);
  else
    json.null();
  return with_checksum(json);
}

std::string read_selection(const std::string& path, Selection& out) {
  return read_document(path, kSelectionSchema, [&](const json& document) {
    read(document.at("inputs"), out.inputs);
    out.named = value<bool>(document, "named");
    read(document.at("slabs"), out.slabs);
  });
}

std::string read_slab_file(const std::string& path, SlabFile& out) {
  out = {};
  return read_document(path, kSlabSchema, [&](const json& document) {
    out.software = value<std::string>(document, "software");
    out.build = value<std::string>(document, "build");
    out.inputs_sha256 = value<std::string>(document, "inputs_sha256");
    out.instruction_set = value<std::string>(document, "instruction_set");
    out.key = value<std::int64_t>(document, "key");
    if (!document.at("verify").is_null()) out.record.verified = verified_slab(document);
    if (!document.at("what_if").is_null()) out.record.judged = what_if_slab(document.at("what_if"));
  });
}

ShardFolder shard_folder(const std::string& dir) {
  static const std::regex selection("selection-[0-9a-f]{16}\\.json");
  static const std::regex slab("[0-9]+-[0-9a-f]{16}\\.json");
  static const std::regex part(".*\\.json\\.part-[a-z0-9]{6}");  // base/durable.h
  ShardFolder folder;
  std::error_code fault;
  for (fs::directory_iterator entry(dir, fault), end; !fault && entry != end; entry.increment(fault)) {
    const std::string file = entry->path().filename().string();
    std::error_code ignored;
    if (file.starts_with(".") || std::regex_match(file, part)) continue;
    if (!fs::is_regular_file(entry->symlink_status(ignored)))
      folder.foreign.push_back(file);
    else if (std::regex_match(file, selection))
      folder.selections.push_back(file);
    else
      (std::regex_match(file, slab) ? folder.slabs : folder.foreign).push_back(file);
  }
  if (fault) stop(kBadInput, fmt::format("{}: the folder cannot be read: {}", dir, fault.message()));
  for (std::vector<std::string>* list : {&folder.selections, &folder.slabs, &folder.foreign})
    std::sort(list->begin(), list->end());
  return folder;
}

}  // namespace slabd::cli
