// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#ifdef SLABD_REMOVABLE_RULES
#include <bitset>
#endif

/// Safety rules that the simulation must find missing (tests/sim, script/sim-rules). Each place that enforces one reads
/// `holds(Rule::name)`, which is the constant true in every program but slabd_sim_rules; there --without NAME removes a
/// rule. Only files with such a place include this header.
namespace slabd {

enum class Rule : std::uint8_t {
  result_after_commit,
  acquired_after_commit,
  robot_still,
  scan_new,
  scan_new_over_restarts,
  unseen_scan_discarded,
  given_up_scan_recorded,
  one_end_per_slab,
  session_after_commit,
  all_stations_pass,
  synced_commits,
  buffer_kept_while_measured,
  record_kept_over_restarts,
  record_numbers_continue,
  sessions_continue,
  slab_keys_continue,
  open_slab_restored,
  command_number_next,
  connection_closed_on_failure,
  log_durable_at_start,
  store_retried,
  count
};
inline constexpr std::size_t kRules = static_cast<std::size_t>(Rule::count);

struct RuleText {
  Rule rule = Rule::count;
  std::string_view name;  ///< of --without: the enumerator
  std::string_view text;
};
inline constexpr std::array<RuleText, kRules> kRuleTexts = {{
    {Rule::result_after_commit, "result_after_commit", "a result is shown only when it is durable"},
    {Rule::acquired_after_commit, "acquired_after_commit", "ACQUIRED is shown only when scan and pose are durable"},
    {Rule::robot_still, "robot_still", "the robot must have stood still over the whole exposure"},
    {Rule::scan_new, "scan_new", "the points of an earlier scan are refused"},
    {Rule::scan_new_over_restarts, "scan_new_over_restarts",
     "the points of an earlier scan are refused, over restarts"},
    {Rule::unseen_scan_discarded, "unseen_scan_discarded",
     "what the scanner could not deliver is not the next block's scan"},
    {Rule::given_up_scan_recorded, "given_up_scan_recorded",
     "a station given up for a new scan has no old pass, over restarts"},
    {Rule::one_end_per_slab, "one_end_per_slab", "a slab does not end while a command is on its way to the journal"},
    {Rule::session_after_commit, "session_after_commit", "a session number is stored before it is shown"},
    {Rule::all_stations_pass, "all_stations_pass", "a slab passes only when each of its stations passes"},
    {Rule::synced_commits, "synced_commits", "the database syncs every commit (synchronous = EXTRA)"},
    {Rule::buffer_kept_while_measured, "buffer_kept_while_measured",
     "a buffer belongs to its measurement until that is over"},
    {Rule::record_kept_over_restarts, "record_kept_over_restarts",
     "a record is shown until it is acknowledged, over restarts"},
    {Rule::record_numbers_continue, "record_numbers_continue", "record numbers go on where the last process stopped"},
    {Rule::sessions_continue, "sessions_continue", "sessions go on where the last process stopped"},
    {Rule::slab_keys_continue, "slab_keys_continue", "slab keys go on where the last process stopped"},
    {Rule::open_slab_restored, "open_slab_restored", "an open slab comes back with what was scanned of it"},
    {Rule::command_number_next, "command_number_next", "a command has the number after CMD_ACK"},
    {Rule::connection_closed_on_failure, "connection_closed_on_failure",
     "a connection that failed to write is closed, and the file looked at again"},
    {Rule::log_durable_at_start, "log_durable_at_start", "the log is made durable before the first commit behind it"},
    {Rule::store_retried, "store_retried", "a store that failed at the start is tried again"},
}};
static_assert(
    [] {
      for (std::size_t i = 0; i < kRules; ++i)
        if (kRuleTexts[i].rule != static_cast<Rule>(i)) return false;
      return true;
    }(),
    "the texts have the order of the enumerators, and none is missing");

#ifdef SLABD_REMOVABLE_RULES
inline std::bitset<kRules> removed_rules;
[[nodiscard]] inline bool holds(Rule rule) {
  return !removed_rules[static_cast<std::size_t>(rule)];
}
#else
[[nodiscard]] constexpr bool holds(Rule /*rule*/) {
  return true;
}
#endif

}  // namespace slabd
