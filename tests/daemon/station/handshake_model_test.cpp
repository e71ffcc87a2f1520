// SPDX-License-Identifier: Apache-2.0
#include "tests/daemon/station/handshake_model.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <vector>

namespace slabd::handshake {
namespace {

std::string told(const Finding& finding) {
  std::string text = finding.violation + "\n";
  for (const std::string& line : finding.story) text += "  " + line + "\n";
  return text;
}

TEST(HandshakeModel, no_wrong_place_no_lost_scan_no_lost_result_and_always_a_way_on) {
  std::vector<Mishaps> lives = {{3, 1, 1}, {2, 2, 1}, {2, 1, 0, 1}, {1, 1, 0, 0, 1}};
  // All mishaps together: some fifty million states, five minutes and 8 GB of memory.
  if (std::getenv("SLABD_WHOLE_HANDSHAKE") != nullptr)
    lives.insert(lives.end(), {{1, 1, 0, 2}, {1, 1, 0, 1, 1}, {2, 0, 0, 1, 1}, {1, 0, 1, 1, 1}, {2, 1, 0, 1, 1}});
  for (const Mishaps& mishaps : lives) {
    const Finding finding = explore(Rules{}, mishaps);
    EXPECT_EQ(finding.violation, "") << told(finding);
    // Detects a model in which few steps are possible.
    EXPECT_GT(finding.states, 100'000U);
    std::printf("%zu states\n", finding.states);
  }
}

// A PLC that forgets SYNC_REQ after its start is detected by its heartbeat, if it was down for long enough.
TEST(HandshakeModel, a_lost_heartbeat_replaces_a_missing_sync_req) {
  Rules rules;
  rules.synchronises = false;
  Mishaps mishaps;
  mishaps.deaths_are_noticed = true;
  const Finding held = explore(rules, mishaps);
  EXPECT_EQ(held.violation, "") << told(held);
  rules.session_changes_when_heard_again = false;
  EXPECT_NE(explore(rules, mishaps).violation, "");
}

struct Without {
  const char* name;
  bool Rules::*rule;
  Mishaps mishaps;
};
void PrintTo(const Without& without, std::ostream* out) {
  *out << without.name;
}

class HandshakeModelWithout : public testing::TestWithParam<Without> {};

TEST_P(HandshakeModelWithout, a_counter_example_is_found) {
  Rules rules;
  rules.*GetParam().rule = false;
  const Finding finding = explore(rules, GetParam().mishaps);
  EXPECT_NE(finding.violation, "") << "all " << finding.states << " states are sound without this rule";
  std::printf("without \"%s\": %s", GetParam().name, told(finding).c_str());
}

constexpr Mishaps kOrdinary;
constexpr Mishaps kGivenUp{2, 1, 0, 1};
constexpr Mishaps kStrangers{2, 1, 0, 0, 1};

INSTANTIATE_TEST_SUITE_P(
    AnyRule, HandshakeModelWithout,
    testing::Values(Without{"number_is_successor", &Rules::number_is_successor, kOrdinary},
                    Without{"session_is_echoed", &Rules::session_is_echoed, kOrdinary},
                    Without{"session_changes_at_start", &Rules::session_changes_at_start, kStrangers},
                    Without{"session_changes_on_request", &Rules::session_changes_on_request, kOrdinary},
                    Without{"session_is_durable_first", &Rules::session_is_durable_first, kOrdinary},
                    Without{"scan_is_durable_first", &Rules::scan_is_durable_first, kOrdinary},
                    Without{"result_is_kept", &Rules::result_is_kept, kOrdinary},
                    Without{"enable_is_required", &Rules::enable_is_required, kGivenUp},
                    Without{"one_connection_commands", &Rules::one_connection_commands, kStrangers},
                    Without{"never_scans_by_itself", &Rules::never_scans_by_itself, kGivenUp},
                    Without{"robot_waits_for_acquired", &Rules::robot_waits_for_acquired, kOrdinary},
                    Without{"restarted_plc_waits", &Rules::restarted_plc_waits, kOrdinary},
                    Without{"number_follows_ack", &Rules::number_follows_ack, kOrdinary},
                    Without{"result_is_stored_first", &Rules::result_is_stored_first, kOrdinary},
                    Without{"synchronises", &Rules::synchronises, kOrdinary},
                    Without{"given_up_means_synchronise", &Rules::given_up_means_synchronise, kGivenUp}),
    [](const auto& one) { return std::string(one.param.name); });

}  // namespace
}  // namespace slabd::handshake
