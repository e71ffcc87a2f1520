// SPDX-License-Identifier: Apache-2.0
//
// [robot] or [[robot]], [scanner] or [[scanner]], and [[station]] -> LineArms. A line with one robot and one scanner
// needs no [[station]]. With more, every station of the longest slab is in exactly one [[station]], so that no station
// is scanned by a robot that the configuration does not name.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <string>
#include <utility>
#include <vector>

#include "config/config_parts.h"

namespace slabd::config {
namespace {

constexpr std::size_t kNumbersTextMax = 100;
constexpr const char* kIdForm = "1 to 16 letters, digits, '-' and '_'";

bool is_part_id(std::string_view id) {
  return !id.empty() && id.size() <= PartId::capacity() && std::all_of(id.begin(), id.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
  });
}

std::string ids_of(const std::vector<PartTable>& parts) {
  std::string text;
  for (const PartTable& part : parts) text += fmt::format("{}\"{}\"", text.empty() ? "" : ", ", part.id.view());
  return text;
}

std::optional<std::size_t> index_of(const std::vector<PartTable>& parts, std::string_view id) {
  for (std::size_t i = 0; i < parts.size(); ++i)
    if (parts[i].id == id) return i;
  return std::nullopt;
}

std::optional<unsigned> whole_number(std::string_view text) {
  unsigned number = 0;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (text.empty() || fault != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return number;
}

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  return text;
}

/// True for each station, [station - 1].
using Stations = std::array<bool, limits::kStationsMax>;

/// Parses "1..5, 14..18" or "4".
std::optional<Stations> parse_numbers(std::string_view text) {
  Stations stations{};
  while (true) {
    const std::size_t comma = text.find(',');
    const std::string_view range = trimmed(text.substr(0, comma));
    const std::size_t dots = range.find("..");
    const auto first = whole_number(trimmed(range.substr(0, dots)));
    const auto last = dots == std::string_view::npos ? first : whole_number(trimmed(range.substr(dots + 2)));
    if (!first || !last || *first < 1 || *first > *last || *last > limits::kStationsMax) return std::nullopt;
    for (unsigned station = *first; station <= *last; ++station) {
      if (std::exchange(stations.at(station - 1), true)) return std::nullopt;  // named twice
    }
    if (comma == std::string_view::npos) return stations;
    text.remove_prefix(comma + 1);
  }
}

Stations read_numbers(TableReader& table) {
  Stations stations{};
  if (table.has("number") == table.has("numbers")) {
    table.problem("numbers",
                  "found none or both of number and numbers; allowed is one, such as number = 4 or numbers "
                  "= \"1..9\"");
    return stations;
  }
  std::int64_t number = 0;
  table.optional_integer("number", number, 1, limits::kStationsMax);
  if (number != 0) stations.at(static_cast<std::size_t>(number - 1)) = true;
  std::string text;
  table.optional_text("numbers", text, kNumbersTextMax);
  if (text.empty()) return stations;
  const std::optional<Stations> parsed = parse_numbers(text);
  if (!parsed)
    table.problem("numbers", fmt::format("found \"{}\", allowed are ranges of stations 1..{}, each station once, such "
                                         "as \"1..5, 14..18\"",
                                         text, limits::kStationsMax));
  return parsed.value_or(stations);
}

/// A robot and a scanner by their places in the configuration; npos: not given, or unknown and reported.
struct Pair {
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  std::size_t robot = kNone;
  std::size_t scanner = kNone;
  [[nodiscard]] bool is_whole() const { return robot != kNone && scanner != kNone; }
};

/// Reads the id of a robot or a scanner; the only one need not be named.
std::size_t read_part(TableReader& table, const char* key, const std::vector<PartTable>& parts) {
  if (!table.has(key)) {
    if (parts.size() == 1) return 0;
    table.missing(key, fmt::format("one of {}", ids_of(parts)));
    return Pair::kNone;
  }
  std::string id;
  table.optional_text(key, id, PartId::capacity());
  if (id.empty()) return Pair::kNone;
  const std::optional<std::size_t> index = index_of(parts, id);
  if (!index) table.problem(key, fmt::format("found \"{}\", allowed is one of {}", id, ids_of(parts)));
  return index.value_or(Pair::kNone);
}

struct StationTable {
  const TomlValue* at = nullptr;
  Stations numbers{};
  Pair usual;
  Pair other;              ///< `or`; without a robot if it names a scanner only
  bool has_other = false;  ///< `or` is given and can be read
};

class StationsReader {
 public:
  StationsReader(TableReader& root, const std::vector<PartTable>& robots, const std::vector<PartTable>& scanners,
                 std::vector<Problem>& problems)
      : root_(root),
        robots_(robots),
        scanners_(scanners),
        problems_(problems),
        robot_of_(scanners.size(), Pair::kNone),
        scanner_of_(robots.size(), Pair::kNone) {}

  /// False if the tables have a fault, which is reported.
  bool read(const std::string& path, const TomlValue& list, LineArms& out) {
    const std::size_t before = problems_.size();
    if (list.kind != TomlValue::Kind::array) {
      root_.problem("station", "found one table, allowed are [[station]] tables");
      return false;
    }
    for (const TomlValue& item : list.items) read_one(path, item);
    if (problems_.size() != before) return false;
    for (const StationTable& table : tables_) join(table, table.usual, "station");
    for (StationTable& table : tables_) find_other(table);
    if (problems_.size() != before) return false;
    check_use();
    check_numbers();
    if (problems_.size() != before) return false;
    fill(out);
    return true;
  }

 private:
  void read_one(const std::string& path, const TomlValue& item) {
    if (item.kind != TomlValue::Kind::table) {
      root_.problem_at(item, "station", fmt::format("found {}, allowed is a table [[station]]", found(item)));
      return;
    }
    TableReader table(path, &item, "station", problems_);
    StationTable& read = tables_.emplace_back();
    read.at = &item;
    read.numbers = read_numbers(table);
    read.usual = {read_part(table, "robot", robots_), read_part(table, "scanner", scanners_)};
    if (const TomlValue* other = table.value("or"); other != nullptr) {
      if (other->kind == TomlValue::Kind::text) {
        read.other.scanner = read_part(table, "or", scanners_);
        read.has_other = read.other.scanner != Pair::kNone;
      } else {
        TableReader inner = table.table("or");
        if (inner.present()) {
          read.other = {read_part(inner, "robot", robots_), read_part(inner, "scanner", scanners_)};
          read.has_other = read.other.is_whole();
          inner.finish();
        }
      }
    }
    table.finish();
  }

  /// Notes that this scanner is on the flange of this robot.
  void join(const StationTable& table, const Pair& pair, const char* key) {
    std::size_t& robot = robot_of_[pair.scanner];
    std::size_t& scanner = scanner_of_[pair.robot];
    if (robot != Pair::kNone && robot != pair.robot)
      return root_.problem_at(
          *table.at, key,
          fmt::format("found scanner \"{}\" on robot \"{}\" and on robot \"{}\", allowed is one "
                      "robot",
                      scanners_[pair.scanner].id.view(), robots_[robot].id.view(), robots_[pair.robot].id.view()));
    if (scanner != Pair::kNone && scanner != pair.scanner)
      return root_.problem_at(
          *table.at, key,
          fmt::format("found scanner \"{}\" and scanner \"{}\" on robot \"{}\", allowed is one "
                      "scanner",
                      scanners_[scanner].id.view(), scanners_[pair.scanner].id.view(), robots_[pair.robot].id.view()));
    robot = pair.robot;
    scanner = pair.scanner;
  }

  void find_other(StationTable& table) {
    if (!table.has_other) return;
    Pair& other = table.other;
    if (other.robot == Pair::kNone) other.robot = robot_of_[other.scanner];
    // A scanner that only `or` names is on the robot that has none yet.
    for (std::size_t i = 0; i < robots_.size() && other.robot == Pair::kNone; ++i)
      if (scanner_of_[i] == Pair::kNone) other.robot = i;
    if (other.robot == Pair::kNone)
      return root_.problem_at(
          *table.at, "station.or",
          fmt::format("found scanner \"{}\", which is on no robot", scanners_[other.scanner].id.view()));
    join(table, other, "station.or");
    if (other.robot == table.usual.robot)
      root_.problem_at(*table.at, "station.or",
                       "found the robot and scanner that scan the station usually; allowed "
                       "are the others");
  }

  void check_use() {
    for (std::size_t i = 0; i < robots_.size(); ++i)
      if (scanner_of_[i] == Pair::kNone)
        root_.problem("robot", fmt::format("robot \"{}\" scans no station; allowed is a [[station]] for each robot",
                                           robots_[i].id.view()));
    for (std::size_t i = 0; i < scanners_.size(); ++i)
      if (robot_of_[i] == Pair::kNone)
        root_.problem("scanner", fmt::format("scanner \"{}\" scans no station; allowed is a [[station]] for each "
                                             "scanner",
                                             scanners_[i].id.view()));
  }

  void check_numbers() {
    Stations seen{};
    for (const StationTable& table : tables_)
      for (std::size_t i = 0; i < seen.size(); ++i)
        if (table.numbers[i] && std::exchange(seen[i], true))
          root_.problem_at(*table.at, "station", fmt::format("found station {} a second time, allowed is once", i + 1));
    std::string missing;
    for (std::size_t i = 0; i < seen.size(); ++i)
      if (!seen[i]) missing += fmt::format("{}{}", missing.empty() ? "" : ", ", i + 1);
    if (!missing.empty())
      root_.problem("station", fmt::format("stations {} are in no [[station]]; allowed is each of 1..{} once", missing,
                                           limits::kStationsMax));
  }

  void fill(LineArms& out) const {
    std::vector<std::size_t> arm_of_robot(robots_.size(), Pair::kNone);
    out.list.clear();
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      arm_of_robot[i] = out.list.size();
      static_cast<void>(out.list.push({robots_[i].id, scanners_[scanner_of_[i]].id}));
    }
    for (const StationTable& table : tables_)
      for (std::size_t i = 0; i < table.numbers.size(); ++i) {
        if (!table.numbers[i]) continue;
        ArmChoice& choice = out.of_station[i];
        choice.clear();
        static_cast<void>(choice.push(static_cast<std::uint8_t>(arm_of_robot[table.usual.robot])));
        if (table.has_other) static_cast<void>(choice.push(static_cast<std::uint8_t>(arm_of_robot[table.other.robot])));
      }
  }

  TableReader& root_;
  const std::vector<PartTable>& robots_;
  const std::vector<PartTable>& scanners_;
  std::vector<Problem>& problems_;
  std::vector<StationTable> tables_;
  std::vector<std::size_t> robot_of_;    ///< [scanner]
  std::vector<std::size_t> scanner_of_;  ///< [robot]
};

}  // namespace

std::vector<PartTable> read_parts(TableReader& root, const char* key, const std::string& path,
                                  std::vector<Problem>& problems, std::vector<Problem>* doubts) {
  std::vector<PartTable> parts;
  const TomlValue* const list = root.value(key);
  if (list == nullptr || list->kind != TomlValue::Kind::array) {
    parts.push_back({PartId("1"), root.table(key), false});
    return parts;
  }
  for (const TomlValue& item : list->items) {
    if (item.kind != TomlValue::Kind::table) {
      root.problem_at(item, key, fmt::format("found {}, allowed is a table [[{}]]", found(item), key));
      continue;
    }
    if (parts.size() == limits::kArmsMax) {
      root.problem_at(item, key,
                      fmt::format("found {} tables [[{}]], allowed are {}", list->items.size(), key, limits::kArmsMax));
      break;
    }
    TableReader table(path, &item, key, problems);
    table.keep_doubts(doubts);
    std::string id;
    table.required_text("id", id, PartId::capacity());
    if (!id.empty() && !is_part_id(id))
      table.problem("id", fmt::format("found \"{}\", allowed are {}", id, kIdForm));
    else if (!id.empty() && index_of(parts, id))
      table.problem("id", fmt::format("found \"{}\" twice, allowed is once", id));
    parts.push_back({PartId(id), table, true});
  }
  if (list->items.empty()) root.problem(key, fmt::format("found an empty list, allowed are [[{}]] tables", key));
  if (parts.empty()) parts.push_back({PartId("1"), TableReader(path, nullptr, key, problems), false});
  return parts;
}

void read_arms(TableReader& root, const std::string& path, const std::vector<PartTable>& robots,
               const std::vector<PartTable>& scanners, std::vector<Problem>& problems, LineArms& out) {
  const TomlValue* const list = root.value("station");
  const std::size_t arms = std::min(robots.size(), scanners.size());
  if (list != nullptr && StationsReader(root, robots, scanners, problems).read(path, *list, out)) return;
  if (list == nullptr && (robots.size() > 1 || scanners.size() > 1))
    root.missing("station", "[[station]] tables, which name robot and scanner of every station");
  // With a fault each robot has the scanner of its place, so that the faults of all tables are found.
  out.list.clear();
  for (std::size_t i = 0; i < arms; ++i) static_cast<void>(out.list.push({robots[i].id, scanners[i].id}));
}

std::size_t part_index(const std::vector<PartTable>& parts, const PartId& id) {
  return index_of(parts, id.view()).value_or(0);
}

namespace {

/// True if a connection to one address reaches both.
bool share_listener(const hal::ScanStreamSettings& a, const hal::ScanStreamSettings& b) {
  if (a.port != b.port || a.port == 0) return false;
  const bool any = a.host.view() == "0.0.0.0" || b.host.view() == "0.0.0.0";
  return any || a.host == b.host;
}

}  // namespace

void check_arms_together(const Config& config, std::vector<PartTable>& robots, std::vector<PartTable>& scanners) {
  for (std::size_t i = 1; i < config.arms.list.size(); ++i) {
    const ArmSettings& a = config.arm(0);
    const ArmSettings& b = config.arm(i);
    TableReader& robot = robots[part_index(robots, b.by.robot)].table;
    TableReader& scanner = scanners[part_index(scanners, b.by.scanner)].table;
    // The group and port receive; what follows "?" concerns sending.
    const auto group_of = [](std::string_view url) { return url.substr(0, url.find('?')); };
    if (group_of(a.robot.url.view()) == group_of(b.robot.url.view()) && a.robot.channel == b.robot.channel)
      robot.problem("channel", fmt::format("found channel \"{}\" at {}, which is that of robot \"{}\"; allowed is "
                                           "another one",
                                           b.robot.channel.view(), b.robot.url.view(), a.by.robot.view()));
    if (a.scanner_backend != b.scanner_backend) continue;
    if (a.scanner_backend == hal::ScannerBackend::tcp && share_listener(a.stream, b.stream))
      scanner.problem("listen", fmt::format("found \"{}:{}\", where slabd listens for scanner \"{}\" already; allowed "
                                            "is another port",
                                            b.stream.host.view(), b.stream.port, a.by.scanner.view()));
    if (a.scanner_backend == hal::ScannerBackend::drop) {
      const std::string mine(b.scanner.drop_dir.view());
      const std::string its(a.scanner.drop_dir.view());
      if (lies_in(mine, its) || lies_in(its, mine))
        scanner.problem("drop_dir", fmt::format("found {}, which is in, contains or is the folder {} of scanner "
                                                "\"{}\"; allowed is a folder of its own",
                                                mine, its, a.by.scanner.view()));
    }
  }
}

}  // namespace slabd::config
