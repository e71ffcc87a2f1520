// SPDX-License-Identifier: Apache-2.0
#include "storage/dispositions.h"

#include <string>

#include "base/plain_text.h"

#include "storage/jobs.h"
#include "storage/seals.h"

namespace slabd::storage {
namespace {

[[noreturn]] void refuse(const std::string& why) {
  throw Refusal{error(Code::config, "%s", why.c_str())};
}

/// A name or a reason: one line with at least one visible character.
void need_words(const char* what, const std::string& text, bool may_be_empty = false) {
  constexpr std::size_t kBytesMax = 400;
  if (text.size() > kBytesMax)
    refuse(std::string(what) + " has " + std::to_string(text.size()) + " bytes, allowed are " +
           std::to_string(kBytesMax));
  if (!may_be_empty && text.find_first_not_of(" \t") == std::string::npos)
    refuse(std::string(what) + " is missing: a decision needs it");
  if (!is_plain(text)) refuse(std::string(what) + " holds a control character; allowed is one line of visible text");
}

/// A name without case and without blanks: "Li Wei", "li  wei" and " LI WEI" are one person.
std::string person(const std::string& name) {
  std::string out;
  for (const char c : name)
    if (c != ' ' && c != '\t') out += static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  return out;
}

std::string told(const DispositionRecord& d) {
  return "disposition " + std::to_string(d.n) + " of slab " + std::to_string(d.slab_key) + ": " +
         std::string(name(d.decision));
}

}  // namespace

std::string Dispositions::keep(const KeepDisposition& change) {
  DispositionRecord d = change.record;
  if (d.decision == Disposition::none || name(d.decision).empty())
    refuse("allowed decisions are hold, release_by_concession, rework, scrap, re_inspect");
  need_words("the name of the person", d.who);
  need_words("the reason", d.reason);
  need_words("the authority", d.authority);
  need_words("the second person", d.second, !change.needs_second);
  if (!d.second.empty() && person(d.second) == person(d.authority))
    refuse("the second person is the authority: two persons must decide");
  Statement verdict(db_, "SELECT verdict FROM slab_result WHERE slab_key = ?1");
  if (!verdict.bind(1, d.slab_key).step()) {
    Statement slab(db_, "SELECT 1 FROM slab WHERE slab_key = ?1");
    refuse("slab " + std::to_string(d.slab_key) +
           (slab.bind(1, d.slab_key).step() ? " is still open: decide when it has its verdict" : " is not stored"));
  }
  if (verdict.text(0) == name(Verdict::pass))
    refuse("slab " + std::to_string(d.slab_key) + " passed: decisions are about slabs that did not pass");
  const std::vector<DispositionRecord> before = of_slab(d.slab_key);
  if (!before.empty()) {
    const DispositionRecord& last = before.back();
    const bool again = last.decision == d.decision && last.reason == d.reason && last.authority == d.authority &&
                       last.second == d.second && last.who == d.who;
    if (again) return told(last);
  }
  d.n = static_cast<std::int64_t>(before.size()) + 1;
  Statement insert(db_,
                   "INSERT INTO disposition (slab_key, n, utime_us, who, decision, reason, authority, second) "
                   "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)");
  insert.bind(1, d.slab_key).bind(2, d.n).bind(3, d.utime_us).bind(4, std::string_view(d.who));
  insert.bind(5, name(d.decision)).bind(6, std::string_view(d.reason)).bind(7, std::string_view(d.authority));
  insert.bind(8, std::string_view(d.second)).run();
  Seals(db_).note_decision(d.slab_key);
  return told(d);
}

std::vector<DispositionRecord> Dispositions::of_slab(std::int64_t slab_key) {
  Statement rows(db_,
                 "SELECT n, utime_us, who, decision, reason, authority, second FROM disposition WHERE slab_key = ?1 "
                 "ORDER BY n");
  std::vector<DispositionRecord> list;
  for (rows.bind(1, slab_key); rows.step();) {
    DispositionRecord& d = list.emplace_back();
    d.slab_key = slab_key;
    d.n = rows.integer(0);
    d.utime_us = rows.integer(1);
    d.who = rows.text(2);
    d.decision = disposition_named(rows.text(3)).value_or(Disposition::none);
    if (d.decision == Disposition::none) rows.refuse(3, "holds an unknown value");
    d.reason = rows.text(4);
    d.authority = rows.text(5);
    d.second = rows.text(6);
  }
  return list;
}

}  // namespace slabd::storage
