// SPDX-License-Identifier: Apache-2.0
#include "web/words.h"

#include <array>

#include "report/json.h"
#include "report/words.h"

namespace slabd::web {
namespace {

using report::Json;

constexpr std::array kVerdicts = {Verdict::none,         Verdict::pass,    Verdict::fail,
                                  Verdict::not_measured, Verdict::aborted, Verdict::indeterminate};
/// Codes and reasons have three digits (base/result.h, ItemInfo::reason).
constexpr std::uint16_t kReasonFirst = 100;
constexpr std::uint16_t kReasonEnd = 700;

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
  json.end_object().key("units").begin_object();
  for (std::size_t i = 0; i < kItemCount; ++i) {
    const ItemInfo& facts = info(static_cast<ItemId>(i));
    json.field(facts.name, facts.unit);
  }
  return json.end_object().text();
}

}  // namespace slabd::web
