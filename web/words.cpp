// SPDX-License-Identifier: Apache-2.0
#include "web/words.h"

#include <array>
#include <nlohmann/json.hpp>

#include "report/json.h"
#include "report/retell.h"
#include "report/say.h"

namespace slabd::web {
namespace {

using report::Json;

constexpr std::array kVerdicts = {Verdict::none,         Verdict::pass,    Verdict::fail,
                                  Verdict::not_measured, Verdict::aborted, Verdict::indeterminate};
/// Codes and reasons have three digits (base/result.h, ItemInfo::reason).
constexpr std::uint16_t kReasonFirst = 100;
constexpr std::uint16_t kReasonEnd = 700;

/// Checks of slabctl doctor (cli/doctor), whose document names them in English.
constexpr std::array kChecks = {"configuration", "recipes",        "recipe",         "design sheets",  "user",
                                "database",      "database lock",  "database disk",  "scans",          "scan disk",
                                "scan drop",     "disk speed",     "commit time",    "memory",         "processor",
                                "huge pages",    "clock",          "limits",         "daemon",         "plc",
                                "plc port",      "plc line",       "plc network",    "plc route",      "plc link",
                                "plc heartbeat", "plc enable",     "plc registers",  "word order",     "robot route",
                                "robot link",    "robot poses",    "robot frame",    "robot position", "robot clock",
                                "scanner link",  "scan",           "calibration",    "acceptance",     "daily check",
                                "camera",        "camera packets", "camera buffers", "gauge",          "tie"};

using Document = nlohmann::ordered_json;

std::string text_of(const Document& document) {
  return document.dump(-1, ' ', true, Document::error_handler_t::replace);
}

/// The text at `key`; empty if it is missing or not a text.
std::string text_at(const Document& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
}

/// Translates the text at `key` in its place, if the catalogue has it.
void retell(Document& object, const char* key) {
  const std::string text = text_at(object, key);
  if (!text.empty()) object[key] = sentence_in_chinese(text);
}

void retell_notes(Document& part) {
  if (part.is_object()) retell(part, "note");
  if (part.is_structured())
    for (Document& inner : part) retell_notes(inner);
}

/// Translates the texts of a code, if the object has them.
void retell_code(Document& object) {
  if (!object.is_object() || !object.contains("code") || !object["code"].is_number_unsigned()) return;
  const auto code = static_cast<Code>(object["code"].get<std::uint16_t>());
  if (const std::string text = text_at(object, "text"); !text.empty()) object["text"] = report::retold_code(code, text);
  if (const std::string cure = text_at(object, "cure"); !cure.empty()) object["cure"] = report::retold_cure(code, cure);
}

/// Warnings are in the order of their bits. The text of a bit may name what it is about; the translation does not.
void retell_warnings(Document& status) {
  if (!status.contains("warn") || !status["warn"].is_array()) return;
  unsigned bits = status.value("warn_bits", 0U);
  for (Document& text : status["warn"]) {
    const unsigned lowest = bits & (~bits + 1U);
    bits &= bits - 1U;
    const std::string_view words = report::warning_zh(static_cast<std::uint16_t>(lowest));
    if (lowest != 0 && !words.empty()) text = words;
  }
}

void retell_link(Document& link) {
  if (!link.is_object()) return;
  for (const char* key : {"trouble", "note", "refusal"}) retell(link, key);
  if (link.contains("code"))
    retell_code(link);
  else
    retell(link, "text");
}

void retell_links(Document& links) {
  if (!links.is_object()) return;
  for (auto& [name, link] : links.items()) retell_link(link);
}

/// Robots and scanners of a line, and the tie.
void retell_arms(Document& status) {
  if (status.contains("arms") && status["arms"].is_array())
    for (Document& arm : status["arms"]) {
      if (!arm.is_object()) continue;
      for (const char* key : {"pose", "scanner_link"})
        if (arm.contains(key)) retell_link(arm[key]);
      if (arm.contains("calibration")) retell_notes(arm["calibration"]);
    }
  if (status.contains("tie") && status["tie"].is_object()) retell(status["tie"], "trouble");
}

}  // namespace

std::string words_document(const std::string& language) {
  const report::Language chosen = language == "zh" ? report::Language::zh : report::Language::en;
  Json json("slabd.web_words/1");
  json.field("language", report::code(chosen)).key("items").begin_object();
  for (std::size_t i = 0; i < kItemCount; ++i)
    json.field(info(static_cast<ItemId>(i)).name, report::item_word(static_cast<ItemId>(i), chosen));
  json.end_object().key("verdicts").begin_object();
  for (const Verdict verdict : kVerdicts) json.field(name(verdict), report::verdict_word(verdict, chosen));
  json.end_object().key("reasons").begin_object();
  const std::string_view unknown = describe(static_cast<Code>(1));
  for (std::uint16_t reason = kReasonFirst; reason < kReasonEnd; ++reason)
    if (item_from_reason(reason) || describe(static_cast<Code>(reason)) != unknown)
      json.field(std::to_string(reason), report::reason_sentence(reason, chosen));
  json.end_object().key("checks").begin_object();
  for (const char* const check : kChecks) json.field(check, report::translated(chosen, check));
  json.end_object().key("units").begin_object();
  for (std::size_t i = 0; i < kItemCount; ++i) {
    const ItemInfo& facts = info(static_cast<ItemId>(i));
    json.field(facts.name, facts.unit);
  }
  return json.end_object().text();
}

std::string sentence_in_chinese(const std::string& sentence) {
  return report::retold(sentence).value_or(sentence);
}

std::string status_in_chinese(const std::string& status) {
  Document document = Document::parse(status, nullptr, false);
  if (!document.is_object()) return "null";
  if (document.contains("fault")) retell_code(document["fault"]);
  retell_warnings(document);
  if (document.contains("links")) retell_links(document["links"]);
  if (document.contains("calibration")) retell_notes(document["calibration"]);
  retell_arms(document);
  if (document.contains("alike_recipes") && document["alike_recipes"].is_array())
    for (Document& pair : document["alike_recipes"])
      if (pair.is_object()) retell(pair, "text");
  return text_of(document);
}

std::string notes_in_chinese(const std::string& document) {
  Document parsed = Document::parse(document, nullptr, false);
  if (parsed.is_discarded()) return "null";
  retell_notes(parsed);
  return text_of(parsed);
}

std::string yield_in_chinese(const std::string& row) {
  constexpr std::string_view kBetween = " x ";
  Document parsed = Document::parse(row, nullptr, false);
  if (!parsed.is_object()) return "null";
  const std::string text = text_at(parsed, "main_reason");
  const std::size_t between = text.find(kBetween);
  if (between == std::string::npos) return text_of(parsed);
  const std::size_t begin = between + kBetween.size();
  for (std::uint16_t reason = kReasonFirst; reason < kReasonEnd; ++reason)
    if (report::reason_sentence(reason, report::Language::en) == std::string_view(text).substr(begin)) {
      parsed["main_reason"] = text.substr(0, begin) + report::reason_sentence(reason, report::Language::zh);
      break;
    }
  return text_of(parsed);
}

}  // namespace slabd::web
