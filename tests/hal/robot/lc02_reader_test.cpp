// SPDX-License-Identifier: Apache-2.0
#include "hal/robot/lcm_wire.h"

#include <gtest/gtest.h>

#include <bot_core/rigid_transform_t.hpp>
#include <cstring>
#include <limits>
#include <memory>
#include <slabd/flange_pose_t.hpp>
#include <string>
#include <vector>

namespace slabd::hal {
namespace {

using Datagram = std::vector<std::byte>;

flange_pose_t message() {
  flange_pose_t m{};
  m.utime = 1'700'000'000'000'001;
  m.robot_time_us = -1;
  m.seq = 42;
  m.base_id = 3;
  m.tool_id = -4;
  m.flags = 0b0101;
  m.trans[0] = 1.25;
  m.trans[1] = -2.5;
  m.trans[2] = 0.125;
  m.quat[0] = 0.5;
  m.quat[1] = -0.5;
  m.quat[2] = 0.5;
  m.quat[3] = -0.5;
  return m;
}

/// Encoded as liblcm does: header, channel, NUL, payload.
Datagram datagram(const flange_pose_t& m, const std::string& channel = "FLANGE_POSE") {
  std::string bytes = "LC02";
  bytes += std::string("\0\0\0\7", 4) + channel + '\0';
  std::string payload(static_cast<std::size_t>(m.getEncodedSize()), '\0');
  m.encode(payload.data(), 0, static_cast<int>(payload.size()));
  bytes += payload;
  Datagram out(bytes.size());
  std::memcpy(out.data(), bytes.data(), bytes.size());
  return out;
}

/// Decodes from a heap block of exactly the datagram's size, so that a sanitizer sees any read beyond it.
bool decode(const Datagram& d, PoseSample& sample, PoseLinkCounters& counters,
            std::string_view channel = "FLANGE_POSE") {
  const auto exact = std::make_unique<std::byte[]>(d.size());
  if (!d.empty()) std::memcpy(exact.get(), d.data(), d.size());
  return decode_pose_datagram({exact.get(), d.size()}, channel, sample, counters);
}

enum class Fate { foreign, malformed };

void expect_dropped(const Datagram& d, Fate fate, std::string_view channel = "FLANGE_POSE") {
  PoseSample sample;
  sample.seq = -77;
  PoseLinkCounters counters;
  EXPECT_FALSE(decode(d, sample, counters, channel));
  EXPECT_EQ(counters.accepted, 0U);
  EXPECT_EQ(counters.foreign, fate == Fate::foreign ? 1U : 0U);
  EXPECT_EQ(counters.malformed, fate == Fate::malformed ? 1U : 0U);
  EXPECT_EQ(sample.seq, -77) << "a dropped datagram must leave the sample alone";
}

TEST(Lc02Reader, returns_a_pose_in_mm_with_its_flags) {
  PoseSample sample;
  sample.arrival_ns = 5;
  PoseLinkCounters counters;
  ASSERT_TRUE(decode(datagram(message()), sample, counters));
  EXPECT_EQ(counters.accepted, 1U);
  EXPECT_EQ(sample.arrival_ns, 5) << "left for the caller";
  EXPECT_EQ(sample.utime_us, 1'700'000'000'000'001);
  EXPECT_EQ(sample.seq, 42);
  EXPECT_EQ(sample.base_id, 3);
  EXPECT_EQ(sample.tool_id, -4);
  EXPECT_TRUE(sample.measured);
  EXPECT_FALSE(sample.stopped);
  EXPECT_TRUE(sample.running);
  EXPECT_FALSE(sample.estop);
  EXPECT_EQ(sample.T_base_flange.translation_mm, Vec3(1250.0, -2500.0, 125.0));
  EXPECT_EQ(sample.T_base_flange.rotation.w(), 0.5);
  EXPECT_EQ(sample.T_base_flange.rotation.x(), -0.5);
  EXPECT_EQ(sample.T_base_flange.rotation.z(), -0.5);
}

TEST(Lc02Reader, every_length_except_the_right_one_is_foreign) {
  const Datagram whole = datagram(message());
  ASSERT_EQ(whole.size(), 8U + 12U + 92U);
  for (std::size_t bytes = 0; bytes < whole.size(); ++bytes)
    expect_dropped(Datagram(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(bytes)), Fate::foreign);
  Datagram longer = whole;
  longer.push_back(std::byte{0});
  expect_dropped(longer, Fate::foreign);
}

TEST(Lc02Reader, pose_is_marked_as_emulated_or_commanded_by_its_flags) {
  flange_pose_t m = message();
  const auto read = [&](std::int32_t flags) {
    m.flags = flags;
    PoseSample sample;
    PoseLinkCounters counters;
    EXPECT_TRUE(decode(datagram(m), sample, counters));
    return sample;
  };
  EXPECT_FALSE(read(1).emulated);
  EXPECT_FALSE(read(1).commanded);
  EXPECT_TRUE(read(1 | 16).emulated);
  EXPECT_TRUE(read(0).commanded);
}

TEST(Lc02Reader, another_type_on_the_channel_is_named) {
  const auto named = [](const Datagram& d, PoseType type = PoseType::flange_pose) {
    return std::string(other_type_on(d, "FLANGE_POSE", type).view());
  };
  const Datagram good = datagram(message());
  EXPECT_EQ(named(good), "");
  EXPECT_EQ(named(datagram(message(), "OTHER")), "") << "another channel is ignored";
  EXPECT_EQ(named(Datagram(7)), "");

  EXPECT_EQ(named(good, PoseType::rigid_transform),
            "a message of type slabd.flange_pose_t ([pose] type is bot_core.rigid_transform_t) on FLANGE_POSE");
  bot_core::rigid_transform_t rigid{};
  std::string payload(static_cast<std::size_t>(rigid.getEncodedSize()), '\0');
  rigid.encode(payload.data(), 0, static_cast<int>(payload.size()));
  Datagram other = good;
  other.resize(8 + 12 + payload.size());
  std::memcpy(other.data() + 20, payload.data(), payload.size());
  EXPECT_NE(named(other).find("bot_core.rigid_transform_t ([pose] type is slabd.flange_pose_t) on FLANGE_POSE"),
            std::string::npos);

  Datagram unknown = good;
  for (std::size_t i = 0; i < 8; ++i) unknown[20 + i] = std::byte{0x11};
  EXPECT_NE(named(unknown).find("fingerprint 0x1111111111111111, 92 bytes"), std::string::npos) << named(unknown);
  Datagram cut = good;
  cut.resize(cut.size() - 1);
  EXPECT_NE(named(cut).find("with 91 bytes instead of 92 on FLANGE_POSE"), std::string::npos) << named(cut);
  cut.resize(20 + 3);
  EXPECT_NE(named(cut).find("too short for any type"), std::string::npos);

  std::string fragment("LC03\0\0\0\1\0\1\0\0\0\0\0\0\0\0\0\2", 20);
  fragment += std::string("FLANGE_POSE\0", 12) + std::string(60, 'x');
  Datagram long_message(fragment.size());
  std::memcpy(long_message.data(), fragment.data(), fragment.size());
  EXPECT_NE(named(long_message).find("in fragments (LC03)"), std::string::npos);
}

TEST(Lc02Reader, reads_a_bridges_text_only_from_its_channel_and_without_control_characters) {
  const auto read = [](const std::string& channel, const std::string& payload) {
    const std::string bytes = std::string("LC02\0\0\0\1", 8) + channel + '\0' + payload;
    Datagram datagram(bytes.size());
    std::memcpy(datagram.data(), bytes.data(), bytes.size());
    return std::string(bridge_word_on(datagram, "FLANGE_POSE").view());
  };
  EXPECT_EQ(read("FLANGE_POSE_WORD", "no RSI packets"), "the bridge reports: no RSI packets;");
  EXPECT_EQ(read("FLANGE_POSE_WORD", "a\x1b[2Jb\n\x7f"), "the bridge reports: a?[2Jb??;");
  EXPECT_EQ(read("FLANGE_POSE_WORD", ""), "");
  EXPECT_EQ(read("FLANGE_POSE_WORDS", "x"), "");
  EXPECT_EQ(read("FLANGE_POSE", "x"), "");
  EXPECT_EQ(read("FLANGE_POSF_WORD", "x"), "");
  EXPECT_LE(read("FLANGE_POSE_WORD", std::string(1'400, 'x')).size(), OtherTypeText::capacity());
  EXPECT_EQ(bridge_word_on(Datagram(9), "FLANGE_POSE").view(), "");
}

TEST(Lc02Reader, the_channel_must_be_exact_and_terminated) {
  expect_dropped(datagram(message(), "FLANGE_POSF"), Fate::foreign);
  expect_dropped(datagram(message(), "FLANGE_POS"), Fate::foreign);
  expect_dropped(datagram(message(), "FLANGE_POSES"), Fate::foreign);
  Datagram unterminated = datagram(message());
  unterminated[8 + 11] = std::byte{'S'};
  expect_dropped(unterminated, Fate::foreign);
  Datagram early = datagram(message());
  early[8 + 3] = std::byte{0};
  expect_dropped(early, Fate::foreign);
}

TEST(Lc02Reader, the_longest_channel_works_and_a_longer_one_does_not) {
  PoseSample sample;
  PoseLinkCounters counters;
  const std::string longest(kLcmChannelMax, 'c');
  EXPECT_TRUE(decode(datagram(message(), longest), sample, counters, longest));
  const std::string longer(kLcmChannelMax + 1, 'c');
  expect_dropped(datagram(message(), longer), Fate::foreign, longer);
}

TEST(Lc02Reader, magic_and_fingerprint_must_match_in_every_bit) {
  for (std::size_t byte : {0U, 1U, 2U, 3U, 20U, 21U, 22U, 23U, 24U, 25U, 26U, 27U}) {
    for (unsigned bit = 0; bit < 8; ++bit) {
      Datagram d = datagram(message());
      d[byte] ^= std::byte{static_cast<unsigned char>(1U << bit)};
      expect_dropped(d, Fate::foreign);
    }
  }
  Datagram fragment = datagram(message());
  fragment[3] = std::byte{'3'};  // "LC03": the fragmented form is not supported
  expect_dropped(fragment, Fate::foreign);
}

TEST(Lc02Reader, numbers_that_do_not_form_a_pose_are_malformed) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, inf, -inf, 10.001, -1e300}) {
    for (int k = 0; k < 3; ++k) {
      flange_pose_t m = message();
      m.trans[k] = bad;
      expect_dropped(datagram(m), Fate::malformed);
    }
  }
  for (const double bad : {nan, inf, 0.51, 0.0, -2.0}) {
    for (int k = 0; k < 4; ++k) {
      flange_pose_t m = message();
      m.quat[k] = bad;
      expect_dropped(datagram(m), Fate::malformed);
    }
  }
  flange_pose_t zero = message();
  for (double& q : zero.quat) q = 0.0;
  expect_dropped(datagram(zero), Fate::malformed);
}

TEST(Lc02Reader, a_nearly_unit_quaternion_is_normalised) {
  flange_pose_t m = message();
  for (double& q : m.quat) q *= 1.0009;
  PoseSample sample;
  PoseLinkCounters counters;
  ASSERT_TRUE(decode(datagram(m), sample, counters));
  EXPECT_NEAR(sample.T_base_flange.rotation.norm(), 1.0, 1e-15);
}

TEST(Lc02Reader, random_bytes_and_random_damage_never_pass_as_another_pose) {
  const Datagram good = datagram(message());
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    SCOPED_TRACE(seed);
    Prng prng(seed);
    PoseLinkCounters counters;
    std::uint64_t offered = 0;
    for (int round = 0; round < 20'000; ++round) {
      Datagram d = good;
      if (round % 2 == 0) {
        d.resize(prng.below(200));
        for (std::byte& b : d) b = std::byte{static_cast<unsigned char>(prng.below(256))};
        if (d.size() > 4 && prng.below(2) == 0) std::memcpy(d.data(), "LC02", 4);
      } else {
        const std::size_t hits = 1 + prng.below(4);
        for (std::size_t i = 0; i < hits; ++i)
          d[prng.below(d.size())] = std::byte{static_cast<unsigned char>(prng.below(256))};
      }
      PoseSample sample;
      ++offered;
      if (!decode(d, sample, counters)) continue;
      EXPECT_TRUE(sample.T_base_flange.all_finite());
      EXPECT_LE(sample.T_base_flange.translation_mm.norm(), 10'000.001);
      EXPECT_NEAR(sample.T_base_flange.rotation.norm(), 1.0, 1e-12);
    }
    EXPECT_EQ(counters.accepted + counters.foreign + counters.malformed, offered);
  }
}

// ---- the address -------------------------------------------------------------------------------------------------

TEST(LcmUrl, the_default_address_is_understood) {
  const auto url = parse_lcm_url("udpm://239.255.76.67:7667?ttl=0");
  ASSERT_TRUE(url.ok()) << url.error().text.c_str();
  EXPECT_EQ(url.value().group, 0xEFFF4C43U);
  EXPECT_EQ(url.value().port, 7667);
  EXPECT_EQ(url.value().ttl, 0);
  const auto more = parse_lcm_url("udpm://224.0.0.9:65535?ttl=255&recv_buf_size=2097152");
  ASSERT_TRUE(more.ok());
  EXPECT_EQ(more.value().ttl, 255);
  EXPECT_EQ(more.value().recv_buf_bytes, 2097152U);
}

TEST(LcmUrl, a_wrong_part_is_named) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"tcpq://1.2.3.4:7667", "provider \"tcpq\""},
      {"", "provider \"\""},
      {"udpm://?ttl=0", "group \"\""},
      {"udpm://10.0.0.1:7667?ttl=0", "group \"10.0.0.1\""},
      {"udpm://240.0.0.1:7667?ttl=0", "group \"240.0.0.1\""},
      {"udpm://239.255.76.67?ttl=0", "port \"\""},
      {"udpm://239.255.76.67:0?ttl=0", "port \"0\""},
      {"udpm://239.255.76.67:65536?ttl=0", "port \"65536\""},
      {"udpm://239.255.76.67:7667", "options lack \"ttl\""},
      {"udpm://239.255.76.67:7667?ttl=256", "ttl \"256\""},
      {"udpm://239.255.76.67:7667?ttl=", "ttl \"\""},
      {"udpm://239.255.76.67:7667?ttl=0&recv_buf_size=1", "recv_buf_size \"1\""},
      {"udpm://239.255.76.67:7667?ttl=0&speed=9", "option \"speed\""},
  };
  for (const auto& [url, expected] : cases) {
    const auto parsed = parse_lcm_url(url);
    ASSERT_FALSE(parsed.ok()) << url;
    EXPECT_EQ(parsed.error().code, Code::config);
    EXPECT_NE(parsed.error().text.view().find(expected), std::string_view::npos) << parsed.error().text.c_str();
  }
}

}  // namespace
}  // namespace slabd::hal
