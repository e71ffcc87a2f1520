// SPDX-License-Identifier: Apache-2.0
//
// Numbers carry every digit and a full stop whatever the locale; what is not there is an empty field, never 0. Times
// are UTC. Lines end with CR LF.
#include "cli/export/item_rows.h"

#include <fmt/core.h>

#include <string_view>

#include "report/json.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

constexpr std::string_view kHeading =
    "version,slab_key,slab_id,slab_no,slab_type,began,ended,slab_verdict,slab_reason,recipe,recipe_sha256,guard,"
    "calibration_id,stations_id,software,scope,station,station_to,attempt,scanned,item,unit,nominal,lower,upper,"
    "value,deviation,U,verdict,required,conformance_probability,beside_name,beside,scanner_id,slab_temperature_k,"
    "slab_age_h,slope_datum,emulated";

std::string csv_number(double value) {
  return has_value(value) ? fmt::format("{}", value) : "";
}

std::string csv_station(int station) {
  return station == 0 ? "" : std::to_string(station);
}

class ItemRow {
 public:
  ItemRow& add(std::string_view text) {
    if (count_++ > 0) text_ += ',';
    text_ += csv_field(text);
    return *this;
  }
  /// The fields of another row behind these.
  ItemRow& add(const ItemRow& more) {
    text_ += (count_ > 0 ? "," : "") + more.text_;
    count_ += more.count_;
    return *this;
  }
  ItemRow& add(double value) { return add(std::string_view(csv_number(value))); }
  [[nodiscard]] std::string end() const { return text_ + "\r\n"; }

 private:
  std::string text_;
  std::size_t count_ = 0;
};

/// Text that comes from the PLC, from a file or from the database. Numbers never come here.
std::string text_for(TableFor reader, std::string_view text) {
  const bool computed = !text.empty() && std::string_view("=+-@\t\r\n").find(text.front()) != std::string_view::npos;
  return (reader == TableFor::spreadsheet && computed ? "'" : "") + std::string(text);
}

/// What all rows of a slab begin with.
ItemRow head_of(const storage::SlabRecord& record, TableFor reader) {
  const SlabHeader& slab = record.summary.header;
  ItemRow row;
  row.add(kItemRowsVersion).add(std::to_string(slab.key)).add(text_for(reader, slab.slab_id.view()));
  row.add(std::to_string(slab.slab_no));
  row.add(std::to_string(slab.slab_type)).add(iso_time(slab.began_utime_us));
  row.add(iso_time(record.summary.ended_utime_us)).add(name(record.summary.verdict));
  row.add(std::to_string(record.summary.reason))
      .add(text_for(reader, slab.recipe.view()))
      .add(text_for(reader, slab.recipe_sha256.view()));
  row.add(slab.guard)
      .add(text_for(reader, slab.calibration_id.view()))
      .add(text_for(reader, slab.stations_id.view()))
      .add(text_for(reader, slab.software.view()));
  return row;
}

/// ... and end with.
ItemRow tail_of(const storage::SlabRecord& record, TableFor reader) {
  const SlabHeader& slab = record.summary.header;
  ItemRow row;
  row.add(text_for(reader, slab.scanner_id.view()));
  row.add(slab.temperature_dk == 0 ? kNoValue : slab.temperature_dk / 10.0);
  row.add(slab.age_h == 0 ? "" : std::to_string(slab.age_h)).add(slope_datum(record));
  row.add(slab.emulated != 0 ? "1" : "0");
  return row;
}

std::string row_of(const ItemRow& head, std::string_view scope, const Item& item, const storage::SlabBlock* block,
                   const ItemRow& tail) {
  const ItemInfo& facts = info(item.id);
  ItemRow row = head;
  row.add(scope).add(csv_station(block != nullptr ? block->attempt.station : item.station));
  row.add(csv_station(item.station_to)).add(block != nullptr ? std::to_string(block->attempt.number) : "");
  row.add(block != nullptr ? iso_time(block->attempt.scan_utime_us) : "").add(facts.name).add(name(facts.unit));
  row.add(item.nominal).add(item.lower).add(item.upper).add(item.value).add(item.deviation()).add(item.U);
  row.add(name(item.verdict)).add(item.required ? "1" : "0").add(conformance_probability(item));
  const std::string_view beside = beside_name(item.id);
  row.add(beside).add(beside.empty() ? kNoValue : item.beside).add(tail);
  return row.end();
}

}  // namespace

std::string csv_field(std::string_view text) {
  if (text.find_first_of("\",\r\n") == std::string_view::npos) return std::string(text);
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + "\"";
}

std::string item_heading() {
  return std::string(kHeading) + "\r\n";
}

std::string item_rows(const storage::SlabRecord& record, TableFor reader) {
  const ItemRow head = head_of(record, reader);
  const ItemRow tail = tail_of(record, reader);
  std::string text;
  for (int station = 1; station <= record.summary.header.stations; ++station) {
    const storage::SlabBlock* block = latest(record, station);
    if (block == nullptr || block->phase != StationPhase::measured) continue;
    for (const Item& item : block->block.items) text += row_of(head, "block", item, block, tail);
  }
  for (const Item& item : record.slab.items) text += row_of(head, "slab", item, nullptr, tail);
  return text;
}

}  // namespace slabd::cli
