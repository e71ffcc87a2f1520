// SPDX-License-Identifier: Apache-2.0
#include "gateway/kuka/rsi.h"

#include <gtest/gtest.h>

namespace slabd::gateway::kuka {
namespace {

std::string packet(std::int64_t ipoc, const std::string& more = "") {
  return "<Rob Type=\"KUKA\"><RIst X=\"1620.1234\" Y=\"-35.5\" Z=\"1910\" A=\"30.0\" B=\"-20.0\" C=\"110.0\"/>" + more +
         "<IPOC>" + std::to_string(ipoc) + "</IPOC></Rob>";
}

// Half angles computed by hand: cos/sin of 15, -10 and 55 degrees.
TEST(Rsi, kuka_angles_become_the_quaternion_of_the_controllers_manual) {
  const Result<RsiPacket> read = parse_rsi(packet(4'208'775'012));
  ASSERT_TRUE(read.ok()) << read.error().text.view();
  const Pose& pose = read.value().T_base_flange;
  EXPECT_NEAR(pose.translation_mm.x(), 1620.1234, 1e-12);
  EXPECT_NEAR(pose.translation_mm.y(), -35.5, 1e-12);
  EXPECT_NEAR(pose.translation_mm.z(), 1910.0, 1e-12);
  EXPECT_NEAR(pose.rotation.w(), 0.508799774, 1e-8);
  EXPECT_NEAR(pose.rotation.x(), 0.804997907, 1e-8);
  EXPECT_NEAR(pose.rotation.y(), 0.112584511, 1e-8);
  EXPECT_NEAR(pose.rotation.z(), 0.283594583, 1e-8);
  EXPECT_EQ(read.value().ipoc_ms, 4'208'775'012);
  EXPECT_FALSE(read.value().base_id.has_value());
}

// Directions of the flange axes as seen from the robot, without formulas: A alone turns X towards Y.
TEST(Rsi, a_turns_about_z_b_about_y_c_about_x) {
  const auto pointing = [](const char* angles) {
    const std::string text = std::string("<Rob><RIst X=\"0\" Y=\"0\" Z=\"0\" ") + angles + "/><IPOC>1</IPOC></Rob>";
    return parse_rsi(text).value().T_base_flange.rotation;
  };
  EXPECT_TRUE((pointing("A=\"90\" B=\"0\" C=\"0\"") * Vec3::UnitX()).isApprox(Vec3::UnitY(), 1e-12));
  EXPECT_TRUE((pointing("A=\"0\" B=\"90\" C=\"0\"") * Vec3::UnitX()).isApprox(-Vec3::UnitZ(), 1e-12));
  EXPECT_TRUE((pointing("A=\"0\" B=\"0\" C=\"90\"") * Vec3::UnitY()).isApprox(Vec3::UnitZ(), 1e-12));
  // C first, then A: the order matters.
  EXPECT_TRUE((pointing("A=\"90\" B=\"0\" C=\"90\"") * Vec3::UnitY()).isApprox(Vec3::UnitZ(), 1e-12));
}

TEST(Rsi, base_tool_and_stopped_are_taken_where_they_are_sent) {
  const RsiPacket read = parse_rsi(packet(8, "<Base>3</Base><Tool> 12 </Tool><Stopped>1</Stopped>")).value();
  EXPECT_EQ(read.base_id, 3);
  EXPECT_EQ(read.tool_id, 12);
  EXPECT_EQ(read.stopped, true);
}

TEST(Rsi, a_packet_of_a_kr_c2_with_rist_is_read) {
  const Result<RsiPacket> read = parse_rsi(
      "<Rob TYPE=\"KUKA\">\r\n<RIst X=\"1620.1234\" Y=\"0\" Z=\"1910\" A=\"0\" B=\"90\" C=\"0\"/>\r\n<RSol X=\"0\" "
      "Y=\"0\" "
      "Z=\"0\" A=\"0\" B=\"0\" C=\"0\"/><Delay D=\"0\"/><DiL>0</DiL><Digout o1=\"0\" o2=\"0\" o3=\"0\"/>"
      "<ST_Source>17.232147</ST_Source><IPOC>4208775012</IPOC></Rob>");
  ASSERT_TRUE(read.ok()) << read.error().text.view();
  EXPECT_NEAR(read.value().T_base_flange.translation_mm.x(), 1620.1234, 1e-12);
}

TEST(Rsi, a_sender_without_a_robot_is_flagged_and_the_pose_carries_the_flag) {
  EXPECT_FALSE(parse_rsi(packet(8)).value().emulated);
  EXPECT_FALSE(parse_rsi(packet(8, "<Emulated>0</Emulated>")).value().emulated);
  const RsiPacket emulated = parse_rsi(packet(8, "<Emulated>1</Emulated>")).value();
  EXPECT_TRUE(emulated.emulated);
  Bridge bridge{BridgeSettings{}};
  EXPECT_EQ(bridge.translate(emulated)->flags, 1 | 16);
  EXPECT_EQ(bridge.translate(parse_rsi(packet(12)).value())->flags, 1);
}

TEST(Rsi, reports_the_fault_of_a_packet) {
  const struct {
    std::string text;
    const char* told;
  } cases[] = {
      {"", "byte 0"},
      {"<Rob Type=\"KUKA\"><RIst X=\"1", "byte"},
      {"<Other/>", "<Rob>"},
      {"<Rob><IPOC>1</IPOC></Rob>", "nothing but <IPOC>, as the first packet of a KR C2"},
      {"<Rob Type=\"KUKA\"><RSol X=\"1\"/><IPOC>1</IPOC></Rob>", "no element <RIst>, expected DEF_RIst"},
      {"<Rob TYPE=\"KUKA\"><RSol X=\"1\"/><IPOC>1</IPOC></Rob>", "in the form of a KR C2"},
      {"<Rob Type=\"KUKA\"><ST_Source>17.2</ST_Source><IPOC>1</IPOC></Rob>", "in the form of a KR C2"},
      {"<Rob Type=\"KUKA\"><Dat TAG=\"RIst\"/><IPOC>1</IPOC></Rob>", "in the form of a KR C2"},
      {"<Sen Type=\"ImFree\"><IPOC>1</IPOC></Sen>", "what a computer answers"},
      {packet(4, "<Emulated>2</Emulated>"), "0 to 1"},
      {"<Rob><RIst X=\"1\" Y=\"2\" A=\"0\" B=\"0\" C=\"0\"/><IPOC>1</IPOC></Rob>", "attribute Z"},
      {"<Rob><RIst X=\"1,5\" Y=\"2\" Z=\"3\" A=\"0\" B=\"0\" C=\"0\"/><IPOC>1</IPOC></Rob>", "X=\"1,5\""},
      {"<Rob><RIst X=\"nan\" Y=\"2\" Z=\"3\" A=\"0\" B=\"0\" C=\"0\"/><IPOC>1</IPOC></Rob>", "-10000 to 10000"},
      {"<Rob><RIst X=\"1e9\" Y=\"2\" Z=\"3\" A=\"0\" B=\"0\" C=\"0\"/><IPOC>1</IPOC></Rob>", "-10000 to 10000"},
      {"<Rob><RIst X=\"1\" Y=\"2\" Z=\"3\" A=\"0\" B=\"361\" C=\"0\"/><IPOC>1</IPOC></Rob>", "-360 to 360"},
      {"<Rob><RIst X=\"1\" Y=\"2\" Z=\"3\" A=\"0\" B=\"0\" C=\"0\"/></Rob>", "IPOC"},
      {packet(-4), "from 0"},
      {packet(9'223'372'036'854'776), "to 9223372036854775"},
      {packet(4, "<IPOC>3</IPOC>"), "<IPOC> twice"},
      {packet(4, "<RIst X=\"1\" Y=\"2\" Z=\"3\" A=\"0\" B=\"0\" C=\"0\"/>"), "<RIst> twice"},
      {"<Rob><RIst X=\"1\" X=\"1\" Y=\"2\" Z=\"3\" A=\"0\" B=\"0\" C=\"0\"/><IPOC>1</IPOC></Rob>", "attribute X twice"},
      {"<Rob><RIst X=\"1\" Y=\"2\" Z=\"3\" A=\"0\" B=\"0\" C=\"0\" A=\"9\"/><IPOC>1</IPOC></Rob>", "attribute A twice"},
      {packet(4, "<Base>33</Base>"), "0 to 32"},
      {packet(4, "<Stopped>yes</Stopped>"), "0 to 1"},
      {std::string(2'000, ' ') + packet(4), "1500"},
  };
  for (const auto& c : cases) {
    const Result<RsiPacket> read = parse_rsi(c.text);
    ASSERT_FALSE(read.ok()) << c.text;
    EXPECT_EQ(read.error().code, Code::frame_incomplete);
    EXPECT_NE(read.error().text.view().find(c.told), std::string_view::npos)
        << c.text << "\n  told: " << read.error().text.view();
  }
}

TEST(Rsi, any_cut_and_any_flipped_byte_is_survived) {
  const std::string whole = packet(4'208'775'012, "<Base>0</Base>");
  for (std::size_t n = 0; n < whole.size(); ++n) EXPECT_FALSE(parse_rsi(whole.substr(0, n)).ok()) << n;
  for (std::size_t n = 0; n < whole.size(); ++n)
    for (int bit = 0; bit < 8; ++bit) {
      std::string bent = whole;
      bent[n] = static_cast<char>(bent[n] ^ (1 << bit));
      const Result<RsiPacket> read = parse_rsi(bent);
      EXPECT_TRUE(!read.ok() || read.value().T_base_flange.all_finite()) << bent;
    }
}

RsiPacket at(std::int64_t ipoc) {
  return parse_rsi(packet(ipoc)).value();
}

TEST(Bridge, numbers_follow_the_controllers_cycles) {
  Bridge bridge({4, 7, 9});
  EXPECT_EQ(bridge.translate(at(1'000))->seq, 0);
  EXPECT_EQ(bridge.translate(at(1'004))->seq, 1);
  EXPECT_EQ(bridge.translate(at(1'007))->seq, 2) << "a count that trembles";
  const std::optional<FlangePose> later = bridge.translate(at(1'020));
  EXPECT_EQ(later->seq, 5) << "two cycles never came, and slabd sees a gap";
  EXPECT_EQ(bridge.counters().lost, 2U);
  EXPECT_EQ(later->base_id, 7) << "stated by who started the bridge";
  EXPECT_EQ(later->tool_id, 9);
  EXPECT_EQ(later->flags, 1) << "measured; not declared stationary";
  EXPECT_EQ(later->robot_time_us, 1'020'000);
}

TEST(Bridge, numbers_go_on_where_an_int32_ends) {
  Bridge bridge({4, 0, 0});
  std::int64_t ipoc = 1'000;
  auto last = static_cast<std::uint32_t>(bridge.translate(at(ipoc))->seq);
  for (const std::int64_t cycles : {0x7FFF'FFFELL, 1LL, 1LL, 0x7FFF'FFFELL, 1LL, 1LL}) {
    ipoc += 4 * cycles;
    const auto seq = static_cast<std::uint32_t>(bridge.translate(at(ipoc))->seq);
    EXPECT_EQ(seq - last, static_cast<std::uint32_t>(cycles)) << "anything else is a gap to slabd";
    last = seq;
  }
}

TEST(Bridge, an_overtaken_packet_is_never_published) {
  Bridge bridge({4, 0, 0});
  EXPECT_TRUE(bridge.translate(at(1'000)).has_value());
  EXPECT_TRUE(bridge.translate(at(1'008)).has_value());
  EXPECT_FALSE(bridge.translate(at(1'004)).has_value());
  EXPECT_FALSE(bridge.translate(at(1'008)).has_value()) << "twice";
  EXPECT_EQ(bridge.counters().old, 2U);
  EXPECT_EQ(bridge.translate(at(1'012))->seq, 3);
}

TEST(Bridge, a_controller_that_was_started_again_is_taken_up_with_a_gap) {
  Bridge bridge({12, 0, 0});
  const std::int32_t before = bridge.translate(at(900'000))->seq;
  const std::optional<FlangePose> after = bridge.translate(at(24));
  ASSERT_TRUE(after.has_value());
  EXPECT_GT(after->seq, before + 1);
  EXPECT_EQ(bridge.counters().restarts, 1U);
}

TEST(Bridge, another_controllers_count_is_neither_old_nor_lost_cycles) {
  for (const std::int64_t ipoc : {500, 1'000, 90'000}) {
    Bridge bridge({4, 0, 0});
    const std::int32_t before = bridge.translate(at(1'000))->seq;
    bridge.restart();
    const std::optional<FlangePose> after = bridge.translate(at(ipoc));
    ASSERT_TRUE(after.has_value()) << ipoc;
    EXPECT_EQ(after->seq, before + 2) << "a gap";
    EXPECT_EQ(bridge.translate(at(ipoc + 4))->seq, before + 3);
    EXPECT_EQ(bridge.counters().lost, 0U);
    EXPECT_EQ(bridge.counters().restarts, 1U);
  }
}

TEST(Senders, neither_sender_is_used_while_two_send) {
  using Answer = Senders::Answer;
  Senders senders;
  std::int64_t now_ns = kNsPerS;
  const auto hear = [&](std::uint32_t address) { return senders.hear(address, now_ns += ns_from_ms(4)); };
  EXPECT_EQ(hear(1), Answer::other) << "the first";
  EXPECT_EQ(hear(1), Answer::alone);
  for (int i = 0; i < 1'000; ++i) {
    EXPECT_EQ(hear(2), Answer::two);
    EXPECT_EQ(senders.other_than(2), 1U);
    EXPECT_EQ(hear(1), Answer::two);
    EXPECT_EQ(senders.other_than(1), 2U);
  }
  int until_alone = 0;
  for (; hear(1) == Answer::two; ++until_alone) {
  }
  EXPECT_NEAR(until_alone, 250, 2) << "the other one has been silent for a second";
  EXPECT_EQ(hear(1), Answer::alone);
  int until_taken = 0;
  Answer answer = hear(2);
  for (; answer == Answer::two; answer = hear(2)) ++until_taken;
  EXPECT_NEAR(until_taken, 250, 2) << "a successor waits for the silence of the one before it";
  EXPECT_EQ(answer, Answer::other);
  EXPECT_EQ(hear(2), Answer::alone);
}

TEST(Bridge, the_packets_own_base_and_tool_go_before_the_stated_ones) {
  Bridge bridge({4, 0, 0});
  const RsiPacket packet_with = parse_rsi(packet(4, "<Base>2</Base><Tool>5</Tool><Stopped>1</Stopped>")).value();
  const std::optional<FlangePose> pose = bridge.translate(packet_with);
  EXPECT_EQ(pose->base_id, 2);
  EXPECT_EQ(pose->tool_id, 5);
  EXPECT_EQ(pose->flags, 3);
}

}  // namespace
}  // namespace slabd::gateway::kuka
