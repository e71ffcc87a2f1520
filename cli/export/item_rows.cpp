// SPDX-License-Identifier: Apache-2.0
//
// Times are UTC. Lines end with CR LF.
#include "cli/export/item_rows.h"

#include <sstream>

#include "report/json.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

constexpr const char* kColumns =
    "version,slab_key,slab_id,slab_no,slab_type,began,ended,slab_verdict,slab_reason,recipe,recipe_sha256,guard,"
    "calibration_id,stations_id,software,scope,station,station_to,attempt,scanned,item,unit,nominal,lower,upper,"
    "value,deviation,U,verdict,required,conformance_probability,beside_name,beside,scanner_id,slab_temperature_k,"
    "slab_age_h,slope_datum,emulated";

Table empty_table() {
  Table table;
  std::istringstream keys(kColumns);
  for (std::string key; std::getline(keys, key, ',');) table.columns.emplace_back(key, key);
  return table;
}

/// What is 0 is not there.
Cell unless_0(int number) {
  return number == 0 ? Cell("") : Cell(number);
}

void add_item(Table& table, const storage::SlabRecord& record, const Item& item, const storage::SlabBlock* block) {
  const SlabHeader& slab = record.summary.header;
  const Attempt* attempt = block == nullptr ? nullptr : &block->attempt;
  const std::string_view beside = beside_name(item.id);
  table.add(kItemRowsVersion, slab.key, slab.slab_id, slab.slab_no, slab.slab_type, iso_time(slab.began_utime_us),
            iso_time(record.summary.ended_utime_us), name(record.summary.verdict), record.summary.reason, slab.recipe,
            slab.recipe_sha256, slab.guard, slab.calibration_id, slab.stations_id, slab.software,
            attempt != nullptr ? "block" : "slab", unless_0(attempt != nullptr ? attempt->station : item.station),
            unless_0(item.station_to), attempt != nullptr ? Cell(attempt->number) : "",
            attempt != nullptr ? iso_time(attempt->scan_utime_us) : "", info(item.id).name, name(info(item.id).unit),
            item.nominal, item.lower, item.upper, item.value, item.deviation(), item.U, name(item.verdict),
            item.required, conformance_probability(item), beside, beside.empty() ? kNoValue : item.beside,
            slab.scanner_id, slab.temperature_dk == 0 ? kNoValue : slab.temperature_dk / 10.0, unless_0(slab.age_h),
            slope_datum(record), slab.emulated != 0);
}

}  // namespace

std::string item_heading() {
  return csv_heading(empty_table());
}

std::string item_rows(const storage::SlabRecord& record, TableFor reader) {
  Table table = empty_table();
  for (int station = 1; station <= record.summary.header.stations; ++station) {
    const storage::SlabBlock* block = latest(record, station);
    if (block == nullptr || block->phase != StationPhase::measured) continue;
    for (const Item& item : block->block.items) add_item(table, record, item, block);
  }
  for (const Item& item : record.slab.items) add_item(table, record, item, nullptr);
  return csv_rows(table, reader);
}

}  // namespace slabd::cli
