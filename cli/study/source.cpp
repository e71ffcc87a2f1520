// SPDX-License-Identifier: Apache-2.0
#include "cli/study/source.h"

#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <map>
#include <regex>

#include "cli/exit.h"
#include "config/config.h"
#include "daemon/measure.h"
#include "report/figures.h"
#include "report/slab_view.h"
#include "report/words.h"

namespace slabd::cli::study {

Reading reading_of(const Item& item) {
  return {std::string(info(item.id).name), item.station, item.station_to, item.value, item.lower, item.upper, item.U};
}

bool same_limits(const Reading& a, const Reading& b) {
  const auto same = [](double x, double y) { return x == y || (!has_value(x) && !has_value(y)); };
  return same(a.lower, b.lower) && same(a.upper, b.upper);
}

std::string limits_text(const Reading& reading) {
  const bool lower = has_value(reading.lower);
  const bool upper = has_value(reading.upper);
  if (lower && upper) return fmt::format("{} .. {}", reading.lower, reading.upper);
  if (upper) return fmt::format("at most {}", reading.upper);
  return lower ? fmt::format("at least {}", reading.lower) : "none";
}

std::string block_text(int block, int block_to) {
  if (block == 0) return "-";
  return block_to == 0 ? std::to_string(block) : fmt::format("{}-{}", block, block_to);
}

std::string title_of(const Reading& reading) {
  if (reading.block == 0) return reading.item;
  return fmt::format("{}, block {}", reading.item, block_text(reading.block, reading.block_to));
}

int decimals_of(const std::string& item) {
  const auto id = item_from_name(item);
  return id ? report::decimals(*id) : 4;
}

std::string unit_of(const std::string& item) {
  const auto id = item_from_name(item);
  return id ? std::string(slabd::name(info(*id).unit)) : std::string();
}

std::string judgement_word(Judgement judgement, report::Language language) {
  switch (judgement) {
    case Judgement::not_judged: break;
    case Judgement::capable: return report::pick(language, "capable", "能力满足");
    case Judgement::not_capable: return report::pick(language, "not capable", "能力不足");
    case Judgement::undecided: return report::pick(language, "undecided", "未定");
  }
  return report::pick(language, "not judged", "未评定");
}

std::string pick(Reader reader, std::string_view en, std::string_view zh) {
  return report::pick(reader.value_or(report::Language::en), en, zh);
}

std::string subject_of(const Reading& reading, Reader reader) {
  const auto id = item_from_name(reading.item);
  if (!reader || !id) return title_of(reading);
  return fmt::format("{} {}", report::item_word(*id, *reader),
                     reading.block == 0 ? "" : block_text(reading.block, reading.block_to));
}

report::Cell judged(Judgement judgement, const std::string& reason, Reader reader) {
  if (judgement == Judgement::not_judged) return "";
  const std::string word = reader ? judgement_word(judgement, *reader) : std::string(name(judgement));
  return {as_verdict(judgement), word + (reason.empty() ? "" : ": " + reason)};
}

std::size_t rank_of(const std::string& item) {
  const auto id = item_from_name(item);
  return id ? static_cast<std::size_t>(*id) : kItemCount;
}

std::string same_scan_twice(std::span<const MeasuredOnce> measurements) {
  const auto same = [](const MeasuredOnce& a, const MeasuredOnce& b) {
    if (a.readings.size() != b.readings.size()) return false;
    bool any = false;
    for (std::size_t i = 0; i < a.readings.size(); ++i) {
      const Reading& x = a.readings[i];
      const Reading& y = b.readings[i];
      if (x.item != y.item || x.block != y.block || has_value(x.value) != has_value(y.value)) return false;
      if (has_value(x.value) && x.value != y.value) return false;
      any = any || has_value(x.value);
    }
    return any;
  };
  for (std::size_t i = 0; i < measurements.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (same(measurements[j], measurements[i]))
        return fmt::format("{} and {}", measurements[j].name, measurements[i].name);
  return {};
}

ScanMeter::ScanMeter(const Recipe& recipe, const hal::ScanForm& form, int threads)
    : memory_(limits::kScanSlotBytes),
      xyz_(memory_.take<float>(limits::kScanPointsMax * 3)),
      form_(form),
      clock_(hal::make_system_clock()),
      inspector_(threads) {
  inspector_.use(recipe);
}

Result<std::vector<Reading>> ScanMeter::measure(const std::string& path, int block, const Pose& T_block_scanner) {
  const Result<ScanShape> read = hal::read_scan(path.c_str(), form_, xyz_, inspector_.team());
  if (!read.ok()) return read.error();
  const ScanShape& shape = shape_ = read.value();
  const algo::Cloud cloud{xyz_, shape.points, shape.width, shape.height};
  // A block that was not found gives items without a value, which the study counts.
  static_cast<void>(
      daemon::measure_block(inspector_, *clock_, block, Pose::identity(), T_block_scanner, cloud, shape, 0.0));
  std::vector<Reading> readings;
  for (const Item& item : inspector_.result().items) {
    readings.push_back(reading_of(item));
    readings.back().block = block;
  }
  return readings;
}

Result<std::vector<std::string>> scan_files(const std::vector<std::string>& names) {
  namespace fs = std::filesystem;
  std::vector<std::string> files;
  for (const std::string& name : names) {
    std::error_code trouble;
    if (!fs::is_directory(name, trouble)) {
      files.push_back(name);
      continue;
    }
    std::vector<std::string> inside;
    for (fs::directory_iterator at(name, trouble), end; !trouble && at != end; at.increment(trouble)) {
      const std::string path = at->path().string();
      if (hal::scan_format_of(path) && at->path().extension() != ".csv") inside.push_back(path);
    }
    if (trouble) return error(Code::config, "%s cannot be read: %s", name.c_str(), trouble.message().c_str());
    if (inside.empty()) return error(Code::config, "%s: no scans (.ply .pcd .xyz .asc .txt) in it", name.c_str());
    std::sort(inside.begin(), inside.end());
    files.insert(files.end(), inside.begin(), inside.end());
  }
  return files;
}

MeasuredOnce measurement_of(const storage::SlabRecord& record) {
  MeasuredOnce measurement;
  measurement.name = fmt::format("{} ({})", record.summary.header.key, record.summary.header.slab_id.view());
  for (int station = 1; station <= record.summary.header.stations; ++station) {
    const storage::SlabBlock* block = report::latest(record, station);
    if (block == nullptr) continue;
    for (const Item& item : block->block.items) {
      measurement.readings.push_back(reading_of(item));
      measurement.readings.back().block = station;
    }
  }
  for (const Item& item : record.slab.items) {
    Reading reading = reading_of(item);
    const auto before = std::find_if(measurement.readings.begin(), measurement.readings.end(), [&](const Reading& r) {
      return r.item == reading.item && r.block == reading.block && r.block_to == reading.block_to;
    });
    // An item without limits is for information, as if slopes are judged against the slab's top: the block's item
    // remains.
    const bool judged = has_value(reading.lower) || has_value(reading.upper);
    if (before == measurement.readings.end()) {
      measurement.readings.push_back(std::move(reading));
    } else if (judged || (!has_value(before->lower) && !has_value(before->upper))) {
      *before = std::move(reading);
    }
  }
  return measurement;
}

std::vector<MeasuredOnce> attempts_of(const storage::SlabRecord& record) {
  std::vector<MeasuredOnce> measurements;
  for (const storage::SlabBlock& block : record.blocks) {
    MeasuredOnce& measurement = measurements.emplace_back();
    measurement.name =
        fmt::format("{} block {} attempt {}", record.summary.header.key, block.attempt.station, block.attempt.number);
    for (const Item& item : block.block.items) {
      measurement.readings.push_back(reading_of(item));
      measurement.readings.back().block = block.attempt.station;
    }
  }
  return measurements;
}

Result<std::vector<storage::SlabRecord>> slabs_named(storage::Reader& reader, const std::string& wanted,
                                                     std::size_t limit) {
  std::vector<storage::SlabRecord> records;
  const report::SlabName name = report::slab_name(wanted);
  std::optional<storage::SlabRecord> of_key;
  if (name.key) {
    auto by_key = reader.slab(*name.key);
    if (!by_key.ok()) return by_key.error();
    of_key = std::move(by_key.value());
  }
  std::vector<std::int64_t> keys;
  if (!name.id.empty()) {
    auto of_id = reader.find_id(name.id);
    if (!of_id.ok()) return of_id.error();
    keys = std::move(of_id.value());
  }
  if (keys.empty() && !of_key && name.no) {
    auto of_no = reader.find_no(*name.no);
    if (!of_no.ok()) return of_no.error();
    keys = std::move(of_no.value());
  }
  for (const std::int64_t key : keys) {
    if (records.size() >= limit) break;
    auto record = reader.slab(key);
    if (!record.ok()) return record.error();
    if (!record.value() || report::is_open(*record.value()) || report::is_aborted(*record.value())) continue;
    if (of_key && key != of_key->summary.header.key) return report::two_slabs(name, *of_key);
    records.push_back(std::move(*record.value()));
  }
  if (of_key) {
    records.clear();
    records.push_back(std::move(*of_key));
    return records;
  }
  std::reverse(records.begin(), records.end());
  return records;
}

Error no_slab_named(const std::string& wanted) {
  return error(Code::config, "no slab that has ended (not aborted) with key or id '%s'; `slabctl history` lists them",
               wanted.c_str());
}

Result<std::vector<MeasuredOnce>> measurements_of(const CsvTable& table) {
  if (const Status good = table.expect({"item", "value"}, {"run", "block", "lower", "upper"}); !good.ok())
    return good.error();
  std::vector<MeasuredOnce> measurements;
  struct First {
    std::size_t row = 0;
    Reading reading;
    std::size_t count = 0;
  };
  std::map<std::pair<std::string, int>, First> seen;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    Reading reading;
    reading.item = table.cell(row, "item");
    if (reading.item.empty()) return error(Code::config, "%s: no item", table.place(row).c_str());
    const Result<int> block = table.block(row);
    if (!block.ok()) return block.error();
    reading.block = block.value();
    const Result<double> value = table.number(row, "value");
    if (!value.ok()) return value.error();
    reading.value = value.value();
    const Result<CsvTable::Limits> limits = table.limits(row);
    if (!limits.ok()) return limits.error();
    reading.lower = limits.value().lower;
    reading.upper = limits.value().upper;
    First& first = seen.try_emplace({reading.item, reading.block}, First{row, reading, 0}).first->second;
    ++first.count;
    if (!same_limits(first.reading, reading))
      return error(Code::config, "%s and %s: limits of %s are %s and %s; all runs are judged by the same",
                   table.place(first.row).c_str(), table.place(row).c_str(), title_of(reading).c_str(),
                   limits_text(first.reading).c_str(), limits_text(reading).c_str());
    std::string run = table.cell(row, "run");
    if (run.empty()) run = std::to_string(first.count);
    auto measurement =
        std::find_if(measurements.begin(), measurements.end(), [&](const MeasuredOnce& t) { return t.name == run; });
    if (measurement == measurements.end()) measurement = measurements.insert(measurements.end(), MeasuredOnce{run, {}});
    for (const Reading& other : measurement->readings)
      if (other.item == reading.item && other.block == reading.block)
        return error(Code::config, "%s: run %s has %s twice", table.place(row).c_str(), run.c_str(),
                     title_of(reading).c_str());
    measurement->readings.push_back(std::move(reading));
  }
  return measurements;
}

namespace {

/// Number of names in a message.
constexpr std::size_t kSentencesShown = 6;

template <typename T>
void add_once(std::vector<T>& list, const T& value) {
  if (std::find(list.begin(), list.end(), value) == list.end()) list.push_back(value);
}

/// "'A', 'B', 'C' and 15 more"
std::string listed(const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < std::min(names.size(), kSentencesShown); ++i)
    text += fmt::format("{}'{}'", i == 0 ? "" : ", ", names[i]);
  if (names.size() > kSentencesShown) text += fmt::format(" and {} more", names.size() - kSentencesShown);
  return text;
}

std::vector<std::string> texts_of(const std::vector<int>& numbers) {
  std::vector<std::string> texts;
  for (const int number : numbers) texts.push_back(std::to_string(number));
  return texts;
}

}  // namespace

std::optional<int> block_in_name(const std::string& path) {
  const std::string stem = std::filesystem::path(path).stem().string();
  static const std::regex kSpool("^([0-9]{2})-[0-9]{1,3}$");
  static const std::regex kWord("(^|[^a-z])(block|station|seat)[ _-]?([0-9]{1,2})([^0-9]|$)", std::regex::icase);
  std::smatch found;
  int block = 0;
  if (std::regex_search(stem, found, kSpool)) block = std::stoi(found[1]);
  if (block == 0 && std::regex_search(stem, found, kWord)) block = std::stoi(found[3]);
  return block >= 1 && block <= static_cast<int>(limits::kStationsMax) ? std::optional(block) : std::nullopt;
}

std::vector<std::string> StudyNotes::sentences() const {
  std::vector<std::string> list;
  if (emulated != 0) list.push_back(report::emulation_notice(emulated, report::Language::en));
  if (!differs.empty())
    list.push_back(fmt::format("taken for one part because of --same-part \"{}\", although:", same_part));
  list.insert(list.end(), differs.begin(), differs.end());
  return list;
}

void write_notes(report::Json& json, const StudyNotes& notes) {
  json.key("same_part");
  if (notes.differs.empty()) {
    json.null();
  } else {
    json.begin_object().field("why", notes.same_part).field("differs", notes.differs).end_object();
  }
  report::write_emulation(json, notes.emulated);
}

void SamePart::add_slab(const std::string& part, const SlabHeader& slab) {
  Part& known = parts_[part];
  add_once(known.ids, std::string(slab.slab_id.view()));
  add_once(known.types, static_cast<int>(slab.slab_type));
  emulated_ |= slab.emulated;
  any_real_ = any_real_ || slab.emulated == 0;
}

void SamePart::add_scan(const std::string& part, const std::string& path, int block, const ScanShape& shape) {
  add_once(parts_[part].blocks, block);
  const unsigned bits = shape.emulated ? kEmulatedScan : 0U;
  emulated_ |= bits;
  any_real_ = any_real_ || bits == 0;
  const std::optional<int> named = block_in_name(path);
  const int stated = shape.emulated_block != 0 ? shape.emulated_block : named.value_or(0);
  if (stated != 0 && stated != block)
    wrong_blocks_.push_back(fmt::format("{} is of block {} by its {}, and is measured as block {}", path, stated,
                                        shape.emulated_block != 0 ? "comment" : "name", block));
}

StudyNotes SamePart::settle(const std::string& why) const {
  StudyNotes notes;
  notes.same_part = why;
  notes.emulated = static_cast<std::uint8_t>(emulated_);
  for (const auto& [name, part] : parts_) {
    const std::string what = name.empty() ? "one part" : fmt::format("part '{}'", name);
    if (part.ids.size() > 1)
      notes.differs.push_back(
          fmt::format("{} slabs of different ids are taken for {}: {}", part.ids.size(), what, listed(part.ids)));
    if (part.types.size() > 1)
      notes.differs.push_back(
          fmt::format("slabs of different types are taken for {}: {}", what, listed(texts_of(part.types))));
    if (part.blocks.size() > 1)
      notes.differs.push_back(
          fmt::format("scans of different blocks are taken for {}: {}", what, listed(texts_of(part.blocks))));
  }
  for (std::size_t i = 0; i < std::min(wrong_blocks_.size(), kSentencesShown); ++i)
    notes.differs.push_back(wrong_blocks_[i]);
  if (wrong_blocks_.size() > kSentencesShown)
    notes.differs.push_back(fmt::format("and {} more scans of other blocks", wrong_blocks_.size() - kSentencesShown));
  if (emulated_ != 0 && any_real_) notes.differs.emplace_back("emulated measurements are mixed with real ones");
  if (notes.differs.empty() || !why.empty()) return notes;
  for (const std::string& sentence : notes.differs) complain(sentence);
  stop(kBadInput,
       "a study is about one part measured again; if these are one all the same, say why: --same-part \"WHY\", which "
       "is printed with the study");
}

}  // namespace slabd::cli::study
