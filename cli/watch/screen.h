// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "base/base.h"
#include "cli/terminal/render.h"
#include "report/words.h"
#include "storage/storage.h"

/// The operator's screen: its data, and its lines for given columns and rows. Pure functions; the watch command
/// queries the daemon, reads the database and writes the lines.
namespace slabd::cli::watch {

/// Age from which data is shown as outdated.
inline constexpr double kStaleAfter_s = 3.0;

enum class Link : std::uint8_t { plc, robot, scanner, store, calibration, tie };

struct LinkState {
  Link link{};
  bool ok = false;
  std::string word;      ///< "alive", "missing", ...: one word in the screen's language
  std::string cure;      ///< set if not ok
  double for_s = 0.0;    ///< time since the last change of the state ...
  bool at_least = true;  ///< ... or longer: the state is older than the watch
  std::string part{};    ///< id of the robot or scanner; empty on a line with one
};

struct PastSlab {
  std::uint32_t number = 0;
  std::string id;
  Verdict verdict = Verdict::none;  ///< Verdict::none: open
  std::uint16_t reason = 0;
  double age_s = 0.0;  ///< since the end of the slab
  std::uint8_t emulated = 0;
};

/// Slabs since local midnight.
struct Today {
  std::size_t slabs = 0;  ///< ended, without aborted ones
  std::size_t passed = 0;
  std::vector<std::pair<std::string, std::size_t>> reasons;  ///< of the others, the most frequent first
  double takt_s = kNoValue;                                  ///< median time between the ends of two slabs
};

struct Picture {
  double age_s = kNoValue;  ///< age of the daemon's last answer; NaN: it has not answered
  std::string trouble;      ///< reason for a missing answer
  std::string software;
  std::string state;
  double uptime_s = 0.0;
  std::vector<LinkState> links;
  std::uint16_t fault = 0;
  std::string fault_text;
  std::string fault_cure;
  std::vector<std::string> warnings;
  std::string emulation;  ///< banner; empty if everything is real

  bool slab_open = false;
  std::string slab;  ///< slab of the map: "7 \"SLAB-7\""
  int stations_done = 0;
  int current_station = 0;          ///< 0: no station
  std::vector<Verdict> stations;    ///< [station - 1]; of the open slab, otherwise of the last one
  double map_age_s = kNoValue;      ///< since the newest of these verdicts; NaN: unknown
  Verdict verdict = Verdict::none;  ///< of the slab of the map; none while it is open
  std::vector<std::pair<Verdict, std::string>> findings;  ///< of the slab of the map: place, value, limits
  std::string recipe;                                     ///< of the slab of the map
  std::string clock;                                      ///< local time, "14:05:33"
  Today today;
  std::vector<PastSlab> past;  ///< newest first
  std::string past_trouble;    ///< reason why slabs cannot be read; the last ones are shown faint

  [[nodiscard]] bool stale() const { return !(age_s <= kStaleAfter_s); }
};

/// Counters of the slabs that ended at `since_utime_us` or later.
[[nodiscard]] Today today_of(const std::vector<storage::SlabSummary>& newest_first, std::int64_t since_utime_us,
                             report::Language language);

/// "3 s", "12 min", "5 h", "9 d", in Chinese "3 秒", "12 分钟", "5 小时", "9 天"; "?" for NaN.
[[nodiscard]] std::string age_text(double age_s, report::Language language);

/// Exactly `rows` lines, none wider than `columns`. 80 x 24 contains all important data; a larger screen has larger
/// blocks, the verdict in large letters, more findings and more past slabs. Below 80 columns the blocks are lists of
/// numbers, and long lines are broken.
[[nodiscard]] std::vector<std::string> screen(const Picture& picture, std::size_t columns, std::size_t rows,
                                              report::Style style, report::Language language);

/// Bits of a parsed list of emulation words in slabd.status/1.
template <typename Json>
[[nodiscard]] std::uint8_t emulation_at(const Json& status, const char* key) {
  unsigned bits = 0;
  if (status.contains(key) && status[key].is_array())
    for (const Json& word : status[key])
      if (word.is_string()) bits |= report::emulation_bit(word.template get<std::string>());
  return static_cast<std::uint8_t>(bits);
}
/// The warnings of slabd.status/1 in the language, in the order of their bits. A warning that is unknown here has the
/// daemon's text.
template <typename Json>
[[nodiscard]] std::vector<std::string> warnings_at(const Json& status, report::Language language) {
  std::vector<std::string> texts;
  if (!status.contains("warn") || !status["warn"].is_array()) return texts;
  const Json bits = status.value("warn_bits", Json(0U));
  unsigned rest = bits.is_number_unsigned() ? bits.template get<unsigned>() : 0U;
  for (const Json& warning : status["warn"]) {
    const unsigned lowest = rest & (0U - rest);
    rest &= ~lowest;
    const std::string_view chinese =
        language == report::Language::zh ? report::warning_zh(static_cast<std::uint16_t>(lowest)) : std::string_view();
    texts.push_back(!chinese.empty()      ? std::string(chinese)
                    : warning.is_string() ? warning.template get<std::string>()
                                          : warning.dump());
  }
  return texts;
}
/// Shows the screen on the terminal until q, Ctrl-C or the end of input, then restores the terminal. Queries the
/// daemon at `socket` once a second and reads the database that it names. kUsage if stdout is not a terminal.
[[nodiscard]] int run(const std::string& socket, report::Language language);

}  // namespace slabd::cli::watch
