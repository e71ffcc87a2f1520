// SPDX-License-Identifier: Apache-2.0
#include "cli/replay/remeasure.h"

#include <fmt/core.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>

#include "algo/algo.h"
#include "base/jobs.h"
#include "daemon/measure.h"
#include "hal/scan/packed.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

/// Tolerance of the write time. A file moved into the spool keeps its write time, but between two file systems it is
/// copied after it was detected, which takes a moment.
constexpr std::int64_t kWrittenLater_us = 60'000'000;

bool same(const ScanShape& a, const ScanShape& b) {
  return a.points == b.points && a.finite == b.finite && a.width == b.width && a.height == b.height;
}

/// Differences between the file and the acquired scan. Without a stored checksum of the points only signs of a change
/// can be found.
std::string signs_of_change(const Remeasured& again, const storage::SlabBlock& stored, const ScanShape& shape) {
  const ScanShape& was = stored.attempt.shape;
  if (!same(shape, was))
    return fmt::format("it holds {} points ({} finite, {} x {}), acquired were {} ({} finite, {} x {})", shape.points,
                       shape.finite, shape.width, shape.height, was.points, was.finite, was.width, was.height);
  if (again.altered)
    return fmt::format("its points are not those that were measured: crc32c {:08x} stored, {:08x} now",
                       *stored.attempt.points_crc32c, *again.points_crc32c);
  if (again.proven) return "";
  struct stat file {};
  if (::stat(again.path.c_str(), &file) != 0) return "";
  const std::int64_t written_us = file.st_mtim.tv_sec * std::int64_t{1'000'000};
  if (written_us > stored.attempt.scan_utime_us + kWrittenLater_us)
    return fmt::format("it was written {}, after it had been acquired {}", report::iso_time(written_us),
                       report::iso_time(stored.attempt.scan_utime_us));
  return "";
}

}  // namespace

bool was_refused(const BlockResult& stored, const BlockResult& now) {
  const auto reason_is = [&](Code code) { return stored.reason == static_cast<std::uint16_t>(code); };
  // Like another scan's noise, filter or stop; of another slab type; given up.
  return stored.verdict == Verdict::not_measured && stored.items.empty() && now.reason != stored.reason &&
         (reason_is(Code::frame_incomplete) || reason_is(Code::unknown_type) || reason_is(Code::deadline));
}

namespace {

ScanFormOptions words_of(const hal::ScanForm& form) {
  ScanFormOptions words{.unit = "", .columns = ""};
  words.complete_from(form);
  return words;
}

}  // namespace

ScanForms::ScanForms(const config::Config& config, const ScanFormOptions& given)
    : other_(given.form(config.scanner.form)) {
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm)
    of_scanner_.emplace_back(config.arms.list[arm].scanner, given.form(config.arm(arm).scanner.form));
}

const hal::ScanForm& ScanForms::of(const Attempt& attempt) const {
  for (const auto& [scanner, form] : of_scanner_)
    if (scanner == attempt.by.scanner) return form;
  return other_;
}

std::string ScanForms::joined(std::string ScanFormOptions::*part) const {
  std::string words = words_of(other_).*part;
  const bool all_alike = std::all_of(of_scanner_.begin(), of_scanner_.end(),
                                     [&](const auto& one) { return words_of(one.second).*part == words; });
  if (all_alike) return words;
  words.clear();
  for (const auto& [scanner, form] : of_scanner_) words += (words.empty() ? "" : "+") + words_of(form).*part;
  return words;
}

std::string ScanForms::unit() const {
  return joined(&ScanFormOptions::unit);
}

std::string ScanForms::columns() const {
  return joined(&ScanFormOptions::columns);
}

Remeasurer::Remeasurer(int threads, ScanForms forms, std::string scans_dir)
    : clock_(hal::make_system_clock()),
      memory_(limits::kScanSlotBytes),
      xyz_(memory_.take<float>(limits::kScanPointsMax * 3)),
      inspector_(threads),
      forms_(std::move(forms)),
      scans_dir_(std::move(scans_dir)) {}

void Remeasurer::use(const Recipe& recipe) {
  if (recipe_ == &recipe) return;
  inspector_.use(recipe);
  recipe_ = &recipe;
}

void Remeasurer::measure(const SlabHeader& slab, const SlabBasis& basis, const storage::SlabBlock& stored,
                         Remeasured& out) {
  out = {};
  out.path = scan_at(stored, scans_dir_);
  std::error_code ignored;
  if (!fs::exists(out.path, ignored)) {
    // The daemon deletes scans by slab to keep its budget, and the folder with the last scan.
    const bool pruned = !fs::exists(fs::path(out.path).parent_path(), ignored);
    out.scan = pruned ? Remeasured::Scan::pruned : Remeasured::Scan::missing;
    out.note = pruned ? "the scans of this slab are gone, pruned or moved away" : "its scan is not there";
    return;
  }
  const Result<ScanShape> shape = hal::read_scan(out.path.c_str(), forms_.of(stored.attempt), xyz_, inspector_.team());
  if (!shape) {
    out.scan = Remeasured::Scan::unreadable;
    out.note = std::string(shape.error().text.view());
    return;
  }
  // Computed before measuring, because measuring changes the points in place.
  out.points_crc32c = hal::points_crc32c(xyz_.first(3 * shape.value().points));
  out.proven = stored.attempt.points_crc32c == out.points_crc32c;
  out.altered = (stored.attempt.points_crc32c.has_value() && !out.proven) || !same(shape.value(), stored.attempt.shape);
  const int station = stored.attempt.station;
  const SlabFacts facts = facts_of(slab);
  const algo::Cloud cloud{xyz_, shape.value().points, shape.value().width, shape.value().height};
  // A block that cannot be measured is a normal result, which contains the reason.
  static_cast<void>(daemon::measure_block(inspector_, *clock_, station,
                                          slab.T_base_slab * T_slab_block(*recipe_, facts.design, station),
                                          stored_T_base_scanner(slab, stored.attempt), cloud, shape.value(), 0.0,
                                          basis.verified.at(stored.attempt.arm), facts, stored.attempt.scanner_drift));
  out.scan = Remeasured::Scan::measured;
  out.note = signs_of_change(out, stored, shape.value());
  out.block = inspector_.result();
  daemon::pack_maps(inspector_, out.maps);
}

bool Remeasurer::finds_scan(const storage::SlabBlock& stored) const {
  std::error_code ignored;
  return fs::is_regular_file(scan_at(stored, scans_dir_), ignored);
}

namespace {

/// The numbers of one kept record. nullopt: the database has no such record, or its numbers were changed there.
template <typename Numbers>
Result<std::optional<Numbers>> numbers_of(storage::Reader& reader, std::string_view id) {
  const auto found = reader.calibration(id);
  if (!found) return found.error();
  std::optional<Numbers> numbers;
  if (!found.value() || found.value()->id != id) return numbers;
  const storage::CalibrationRecord& record = *found.value();
  const auto* kept = std::get_if<Numbers>(&record.numbers);
  // A record's id is made from its numbers; that of a record stored again has an added number.
  if (kept != nullptr && record.id.starts_with(storage::calibration_id(record))) numbers = *kept;
  return numbers;
}

std::string_view scanner_id_of(const SlabHeader& slab, std::size_t arm) {
  if (arm == 0) return slab.scanner_id.view();
  return arm <= slab.more_arms.size() ? slab.more_arms[arm - 1].scanner_id.view() : std::string_view();
}

}  // namespace

Result<std::optional<ScannerNumbers>> scanner_of(storage::Reader& reader, const SlabHeader& slab, std::size_t arm) {
  const std::string_view id = scanner_id_of(slab, arm);
  if (id.empty()) return std::optional<ScannerNumbers>(ScannerNumbers{});
  return numbers_of<ScannerNumbers>(reader, id);
}

std::string StoredBasis::missing_text() const {
  return missing.empty() ? "" : fmt::format("the {} {} is not in the database", missing[0].what, missing[0].id);
}

Result<StoredBasis> basis_of(storage::Reader& reader, const storage::SlabRecord& record, const Recipe* recipe) {
  const SlabHeader& slab = record.summary.header;
  StoredBasis stored;
  stored.basis.recipe = recipe;
  stored.basis.T_base_slab = slab.T_base_slab;
  stored.basis.slab = facts_of(slab, record.slab);
  for (std::size_t arm = 0; arm <= slab.more_arms.size(); ++arm) {
    const auto scanner = scanner_of(reader, slab, arm);
    if (!scanner) return scanner.error();
    if (!scanner.value()) stored.missing.push_back({"scanner acceptance", std::string(scanner_id_of(slab, arm))});
    stored.basis.verified.at(arm) = scanner.value().value_or(ScannerNumbers{});
  }
  if (slab.tie_id.empty()) return stored;
  const auto tie = numbers_of<TieNumbers>(reader, slab.tie_id.view());
  if (!tie) return tie.error();
  if (!tie.value()) stored.missing.push_back({"tie", std::string(slab.tie_id.view())});
  stored.basis.has_tie = tie.value().has_value();
  stored.basis.tie = tie.value().value_or(TieNumbers{});
  return stored;
}

std::vector<StationRecord> stations_of(const storage::SlabRecord& record, std::span<const BlockResult* const> blocks) {
  std::vector<StationRecord> stations(limits::kStationsMax);
  for (std::size_t i = 0; i < record.blocks.size(); ++i) {
    const storage::SlabBlock& stored = record.blocks[i];
    StationRecord& station = stations[stored.attempt.station - 1U];
    if (stored.attempt.asked) station.attempts = std::max(station.attempts, stored.attempt.number);
    station.phase = stored.phase;
    station.code = stored.code;
    if (stored.phase != StationPhase::failed) station.attempt = stored.attempt;
    if (stored.phase == StationPhase::measured) station.block = blocks[i] != nullptr ? *blocks[i] : stored.block;
  }
  return stations;
}

std::string scan_at(const storage::SlabBlock& stored, const std::string& scans_dir) {
  const fs::path path(stored.attempt.scan_path.view());
  std::vector<std::string> places = {path.string()};
  if (!scans_dir.empty())
    places.push_back((fs::path(scans_dir) / path.parent_path().filename() / path.filename()).string());
  std::error_code ignored;
  for (const std::string& place : places)
    if (fs::exists(place, ignored)) return place;
  for (const std::string& place : places)
    if (std::string packed = place + std::string(hal::kPackedExtension); fs::exists(packed, ignored)) return packed;
  return places.back();
}

std::vector<Recipe> recipes_in(const std::string& dir, std::vector<config::Problem>& problems) {
  std::vector<Recipe> recipes;
  std::vector<std::string> paths;
  std::error_code fault;
  for (fs::directory_iterator entry(dir, fault), end; !fault && entry != end; entry.increment(fault))
    if (entry->path().extension() == ".toml") paths.push_back(entry->path().string());
  if (fault) problems.push_back({fmt::format("{}: the recipe folder cannot be read: {}", dir, fault.message())});
  std::sort(paths.begin(), paths.end());
  for (const std::string& path : paths) {
    const std::size_t before = problems.size();
    Recipe recipe;
    config::load_recipe(path, recipe, problems);
    if (problems.size() == before) recipes.push_back(recipe);
  }
  return recipes;
}

}  // namespace slabd::cli
