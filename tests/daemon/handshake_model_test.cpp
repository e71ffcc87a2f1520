// SPDX-License-Identifier: Apache-2.0
#include "tests/daemon/handshake_model.h"

#include <gtest/gtest.h>

namespace slabd::handshake {
namespace {

std::string told(const Finding& finding) {
  std::string text = finding.violation + "\n";
  for (const std::string& line : finding.story) text += "  " + line + "\n";
  return text;
}

TEST(HandshakeModel, no_wrong_place_no_lost_scan_no_lost_result_and_always_a_way_on) {
  for (const Mishaps& mishaps : {Mishaps{3, 1, 1}, Mishaps{2, 2, 1}}) {
    const Finding finding = explore(Rules{}, mishaps);
    EXPECT_EQ(finding.violation, "") << told(finding);
    // So that nobody believes a model that cannot move.
    EXPECT_GT(finding.states, 200'000U);
  }
}

// A belt beside the braces: CMD_ACK is durable, so a block meant for the process that died is a duplicate or still
// right. The change tells the PLC of the death.
TEST(HandshakeModel, the_change_of_session_at_slabds_own_start_is_not_what_holds) {
  Rules rules;
  rules.session_changes_at_start = false;
  const Finding finding = explore(rules, Mishaps{2, 2, 1});
  EXPECT_EQ(finding.violation, "") << told(finding);
}

struct Without {
  const char* name;
  bool Rules::*rule;
};
void PrintTo(const Without& without, std::ostream* out) {
  *out << without.name;
}

class HandshakeModelWithout : public testing::TestWithParam<Without> {};

TEST_P(HandshakeModelWithout, a_counter_example_is_found) {
  Rules rules;
  rules.*GetParam().rule = false;
  const Finding finding = explore(rules, Mishaps{});
  EXPECT_NE(finding.violation, "") << "all " << finding.states << " states are sound without this rule";
  std::printf("without \"%s\": %s", GetParam().name, told(finding).c_str());
}

INSTANTIATE_TEST_SUITE_P(AnyRule, HandshakeModelWithout,
                         testing::Values(Without{"number_is_successor", &Rules::number_is_successor},
                                         Without{"session_is_echoed", &Rules::session_is_echoed},
                                         Without{"session_changes_on_request", &Rules::session_changes_on_request},
                                         Without{"session_is_durable_first", &Rules::session_is_durable_first},
                                         Without{"scan_is_durable_first", &Rules::scan_is_durable_first},
                                         Without{"result_is_kept", &Rules::result_is_kept},
                                         Without{"robot_waits_for_acquired", &Rules::robot_waits_for_acquired},
                                         Without{"restarted_plc_waits", &Rules::restarted_plc_waits},
                                         Without{"number_follows_ack", &Rules::number_follows_ack},
                                         Without{"result_is_stored_first", &Rules::result_is_stored_first}),
                         [](const auto& one) { return std::string(one.param.name); });

}  // namespace
}  // namespace slabd::handshake
