// SPDX-License-Identifier: Apache-2.0
#include "storage/gauges.h"

#include <algorithm>
#include <cmath>

#include "base/plain_text.h"
#include "storage/jobs.h"
#include "storage/rows.h"

namespace slabd::storage {
namespace {

[[noreturn]] void refuse(const std::string& sentence) {
  Error why;
  why.code = Code::config;
  why.text.assign(sentence);
  throw Refusal{why};
}

void need_text(const std::string& gauge, const char* what, const std::string& text) {
  constexpr std::size_t kBytesMax = 400;
  if (text.find_first_not_of(" \t") == std::string::npos) refuse(gauge + " is not checked: give " + what);
  if (text.size() > kBytesMax || !is_plain(text))
    refuse(gauge + " is not checked: " + what + " must be one line of at most 400 bytes");
}

std::string check_id(std::string_view gauge, std::int64_t seq) {
  return std::string(gauge) + "-check-" + std::to_string(seq);
}

const std::string& check_columns() {
  static const std::string columns = joined(names_of<GaugeCheck>(), ", ");
  return columns;
}

}  // namespace

std::string Gauges::keep(const KeepGaugeCheck& change) {
  GaugeCheck check = change.check;
  const std::string gauge(check.gauge.view());
  if (!is_gauge_name(gauge)) refuse("a check needs the name of its gauge");
  for (const double number : {check.value, check.master_value, check.master_u, check.within})
    if (!std::isfinite(number)) refuse(gauge + " is not checked: a number is missing");
  if (!(check.within > 0.0) || check.master_u < 0.0) refuse(gauge + " is not checked: its limit or u is negative");
  need_text(gauge, "the name of the operator", change.note.who);
  check.passed = passes(check);
  check.utime_us = change.note.utime_us;
  const std::vector<GaugeCheckRecord> last = checks(gauge, 1);
  if (!last.empty() && last.front().check.utime_us == check.utime_us && last.front().check.value == check.value)
    return check_id(gauge, last.front().seq);
  std::vector<std::string> names = names_of<GaugeCheck>();
  for (const char* column : {"who", "why"}) names.emplace_back(column);
  Statement insert(db_, insert_text("gauge_check", names));
  Bind bind(insert, 1);
  columns(bind, check);
  insert.bind(bind.next_index(), std::string_view(change.note.who))
      .bind(bind.next_index() + 1, std::string_view(change.note.why))
      .run();
  return check_id(gauge, db_.integer("SELECT max(seq) FROM gauge_check"));
}

std::vector<GaugeCheckRecord> Gauges::checks(std::string_view gauge, std::size_t limit) {
  Statement rows(db_, "SELECT seq, who, why, " + check_columns() +
                          " FROM gauge_check WHERE ?1 = '' OR gauge = ?1 ORDER BY seq DESC LIMIT ?2");
  rows.bind(1, gauge).bind(2, static_cast<std::int64_t>(limit));
  std::vector<GaugeCheckRecord> list;
  while (rows.step()) {
    GaugeCheckRecord& record = list.emplace_back();
    record.seq = rows.integer(0);
    record.note.who = rows.text(1);
    record.note.why = rows.text(2);
    read_row(rows, 3, record.check);
    record.note.utime_us = record.check.utime_us;
  }
  return list;
}

std::vector<GaugeSlabValue> Gauges::values(std::string_view gauge, std::size_t limit) {
  std::vector<std::string> names = names_of<GaugeReading>();
  for (std::string& column : names) column.insert(0, "gauge_value.");
  Statement rows(db_, "SELECT slab.slab_key, slab.slab_id, slab.began_utime_us, slab.emulated, " + joined(names, ", ") +
                          " FROM gauge_value JOIN slab USING (slab_key) WHERE gauge = ?1 ORDER BY slab_key DESC "
                          "LIMIT ?2");
  rows.bind(1, gauge).bind(2, static_cast<std::int64_t>(limit));
  std::vector<GaugeSlabValue> list;
  while (rows.step()) {
    GaugeSlabValue& value = list.emplace_back();
    value.slab_key = rows.integer(0);
    value.slab_id.assign(rows.text(1));
    value.began_utime_us = rows.integer(2);
    value.emulated = static_cast<std::uint8_t>(rows.integer(3));
    read_row(rows, 4, value.reading);
  }
  return list;
}

void Gauges::read_line(RecoveredLine& line) {
  Statement newest(db_, "SELECT " + check_columns() +
                            " FROM gauge_check WHERE seq IN (SELECT max(seq) FROM gauge_check GROUP BY gauge)");
  while (newest.step()) read_row(newest, 0, line.gauge_checks.emplace_back());
  Statement used(db_,
                 "SELECT " + joined(names_of<GaugeReading>(), ", ") +
                     " FROM gauge_value WHERE slab_key = (SELECT max(slab_key) FROM gauge_value) ORDER BY position");
  while (used.step()) {
    GaugeReading reading;
    read_row(used, 0, reading);
    if (!line.gauges_used.push(reading)) used.refuse(0, "has more rows than a line has gauges");
  }
  // A run ends with the first other value.
  constexpr std::int64_t kRows = limits::kGaugeStuckSlabs * static_cast<std::int64_t>(limits::kGaugesMax);
  Statement values(db_, "SELECT gauge, value FROM gauge_value WHERE value IS NOT NULL ORDER BY slab_key DESC LIMIT ?1");
  values.bind(1, kRows);
  FixedVector<bool, limits::kGaugesMax> over;
  while (values.step()) {
    const GaugeName name(values.text(0));
    const double value = values.real(1);
    std::size_t i = 0;
    while (i < line.gauge_runs.size() && !(line.gauge_runs[i].gauge == name)) ++i;
    if (i == line.gauge_runs.size() && (!line.gauge_runs.push({name, value, 0}) || !over.push(false))) continue;
    GaugeRun& run = line.gauge_runs[i];
    over[i] = over[i] || run.value != value;
    if (!over[i]) ++run.slabs;
  }
}

}  // namespace slabd::storage
