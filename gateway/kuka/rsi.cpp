// SPDX-License-Identifier: Apache-2.0
#include "gateway/kuka/rsi.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <pugixml.hpp>

namespace slabd::gateway::kuka {
namespace {

constexpr double kReach_mm = 10'000.0;
constexpr double kAngle_deg = 360.0;
constexpr std::int64_t kRestart_ms = 1'000;
/// Limit of IPOC, so that it does not overflow in microseconds.
constexpr std::int64_t kIpocMax_ms = std::numeric_limits<std::int64_t>::max() / 1'000;
constexpr std::int32_t kMeasured = 1;
constexpr std::int32_t kStopped = 2;
constexpr std::int32_t kEmulated = 16;

/// Parses the whole text as a number.
template <typename Number>
bool number_from(std::string_view text, Number& value) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '+')) text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), value);
  return fault == std::errc() && end == text.data() + text.size();
}

Error unusable(const char* what, const char* expected) {
  return error(Code::frame_incomplete, "RSI packet: %s, expected %s", what, expected);
}

/// Error for a packet whose root element is not that of a controller.
Error no_robot(const pugi::xml_document& document) {
  const std::string_view root = document.document_element().name();
  if (root == "Sen")
    return unusable("element <Sen>, which is what a computer answers",
                    "what the controller sends; does another program send to this port?");
  if (root == "rob" || root == "ROB")
    return unusable("element <rob>, not <Rob>", "the names as KUKA's manual writes them");
  return unusable("no element <Rob>", "what a KUKA controller sends");
}

/// Error for a packet without <RIst>. KR C2 has RSI 1 and 2 (Ethernet RSI XML, object ST_ETHERNET). Its packets are
/// accepted if they have <RIst>; its first packet contains only the count, and its own elements begin with ST_.
Error no_place(const pugi::xml_node& robot) {
  bool only_count = static_cast<bool>(robot.child("IPOC"));
  bool of_krc2 = static_cast<bool>(robot.attribute("TYPE"));
  for (const pugi::xml_node& element : robot.children()) {
    const std::string_view name = element.name();
    only_count = only_count && name == "IPOC";
    of_krc2 = of_krc2 || name.substr(0, 3) == "ST_" || name == "Dat" || name == "DEF_RIst";
  }
  if (only_count)
    return unusable("nothing but <IPOC>, as the first packet of a KR C2 (RSI 1 or 2, ST_ETHERNET)",
                    "<RIst> in the next ones: DEF_RIst in the SEND part of the Ethernet configuration");
  if (of_krc2)
    return unusable("no element <RIst>, in the form of a KR C2 (RSI 1 or 2, Ethernet RSI XML)",
                    "DEF_RIst in the SEND part of the file that ST_ETHERNET reads, by UDP; docs/ROBOT.md, KR C2");
  return unusable("no element <RIst>", "DEF_RIst in the SEND part of the ETHERNET object");
}

Status coordinate(const pugi::xml_node& node, const char* attribute, double limit, double& value) {
  const pugi::xml_attribute found = node.attribute(attribute);
  for (pugi::xml_attribute next = found.next_attribute(); next; next = next.next_attribute())
    if (std::string_view(next.name()) == attribute)
      return error(Code::frame_incomplete, "RSI packet: <RIst> has attribute %s twice, expected it once", attribute);
  if (!found) return error(Code::frame_incomplete, "RSI packet: <RIst> has no attribute %s", attribute);
  if (!number_from(std::string_view(found.value()), value) || !(std::abs(value) <= limit))
    return error(Code::frame_incomplete, "RSI packet: <RIst %s=\"%.20s\">, expected a number from -%.0f to %.0f",
                 attribute, found.value(), limit, limit);
  return Nothing{};
}

/// Rejects a packet with an element twice, because the valid one is unknown.
Status expect_once(const pugi::xml_node& robot, const char* element) {
  if (!robot.child(element).next_sibling(element)) return Nothing{};
  return error(Code::frame_incomplete, "RSI packet: <%s> twice, expected it once", element);
}

/// Parses a whole number that may be missing.
template <typename Number>
Status optional_number(const pugi::xml_node& robot, const char* element, std::int64_t low, std::int64_t high,
                       std::optional<Number>& to) {
  const pugi::xml_node node = robot.child(element);
  if (!node) return Nothing{};
  std::int64_t value = 0;
  if (!number_from(std::string_view(node.child_value()), value) || value < low || value > high)
    return error(Code::frame_incomplete, "RSI packet: <%s>%.20s</%s>, expected a whole number from %lld to %lld",
                 element, node.child_value(), element, static_cast<long long>(low), static_cast<long long>(high));
  to = static_cast<Number>(value);
  return Nothing{};
}

}  // namespace

Result<RsiPacket> parse_rsi(std::string_view datagram) {
  if (datagram.size() > kRsiBytesMax) return unusable("longer than 1500 bytes", "one datagram");
  pugi::xml_document document;
  const pugi::xml_parse_result parsed =
      document.load_buffer(datagram.data(), datagram.size(), pugi::parse_minimal, pugi::encoding_utf8);
  if (!parsed)
    return error(Code::frame_incomplete, "RSI packet: byte %lld: %s", static_cast<long long>(parsed.offset),
                 parsed.description());
  const pugi::xml_node robot = document.child("Rob");
  if (!robot) return no_robot(document);
  const pugi::xml_node place = robot.child("RIst");
  if (!place) return no_place(robot);

  for (const char* element : {"RIst", "IPOC", "Base", "Tool", "Stopped", "Emulated"})
    if (const Status once = expect_once(robot, element); !once) return once.error();

  std::array<double, 3> at{};
  std::array<double, 3> angle_deg{};
  static constexpr std::array<const char*, 3> kAxes = {"X", "Y", "Z"};
  static constexpr std::array<const char*, 3> kAngles = {"A", "B", "C"};
  for (std::size_t i = 0; i < 3; ++i)
    if (const Status read = coordinate(place, kAxes[i], kReach_mm, at[i]); !read) return read.error();
  for (std::size_t i = 0; i < 3; ++i)
    if (const Status read = coordinate(place, kAngles[i], kAngle_deg, angle_deg[i]); !read) return read.error();

  RsiPacket packet;
  packet.T_base_flange = {
      rotation_from_kuka_abc(rad_from_deg(angle_deg[0]), rad_from_deg(angle_deg[1]), rad_from_deg(angle_deg[2])),
      Vec3(at[0], at[1], at[2])};
  const pugi::xml_node count = robot.child("IPOC");
  if (!count) return unusable("no element <IPOC>", "the controller's count of milliseconds");
  if (!number_from(std::string_view(count.child_value()), packet.ipoc_ms) || packet.ipoc_ms < 0 ||
      packet.ipoc_ms > kIpocMax_ms)
    return error(Code::frame_incomplete, "RSI packet: <IPOC>%.24s</IPOC>, expected a whole number from 0 to %lld",
                 count.child_value(), static_cast<long long>(kIpocMax_ms));
  std::optional<std::int16_t> stopped;
  std::optional<std::int16_t> emulated;
  for (const Status& read :
       {optional_number(robot, "Base", 0, 32, packet.base_id), optional_number(robot, "Tool", 0, 16, packet.tool_id),
        optional_number(robot, "Stopped", 0, 1, stopped), optional_number(robot, "Emulated", 0, 1, emulated)})
    if (!read) return read.error();
  if (stopped) packet.stopped = *stopped == 1;
  packet.emulated = emulated.value_or(0) == 1;
  return packet;
}

Senders::Answer Senders::hear(std::uint32_t address, std::int64_t now_ns) {
  if (first_.address != address && first_.lately(now_ns)) {
    second_ = {address, now_ns, true};
    return Answer::two;
  }
  const bool same = first_.ever && first_.address == address;
  first_ = {address, now_ns, true};
  if (second_.address == address) second_.ever = false;
  if (second_.lately(now_ns)) return Answer::two;
  return same ? Answer::alone : Answer::other;
}

/// Adds with wraparound through the negative numbers; slabd only uses the difference.
std::int32_t Bridge::seq_ahead(std::int64_t by) const {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(seq_) + static_cast<std::uint32_t>(by));
}

std::optional<FlangePose> Bridge::translate(const RsiPacket& packet) {
  const std::int64_t ahead_ms = packet.ipoc_ms - ipoc_ms_;
  if (ipoc_ms_ < 0) {
    seq_ = seq_ahead(1);
  } else if (ahead_ms > 0 && !restart_) {
    // The count may jitter by a millisecond, which must not count as a lost cycle.
    const std::int64_t cycles = std::max<std::int64_t>(1, (ahead_ms + settings_.cycle_ms / 2) / settings_.cycle_ms);
    counters_.lost += static_cast<std::uint64_t>(cycles - 1);
    seq_ = seq_ahead(cycles);
  } else if (ahead_ms > -kRestart_ms && !restart_) {
    ++counters_.old;
    return std::nullopt;
  } else {
    ++counters_.restarts;
    // Skips a number, so that slabd detects a gap.
    seq_ = seq_ahead(2);
  }
  restart_ = false;
  ipoc_ms_ = packet.ipoc_ms;
  ++counters_.published;

  FlangePose pose;
  pose.robot_time_us = packet.ipoc_ms * 1000;
  pose.seq = seq_;
  pose.base_id = packet.base_id.value_or(settings_.base_id);
  pose.tool_id = packet.tool_id.value_or(settings_.tool_id);
  pose.flags = kMeasured | (packet.stopped.value_or(false) ? kStopped : 0) | (packet.emulated ? kEmulated : 0);
  pose.T_base_flange = packet.T_base_flange;
  return pose;
}

}  // namespace slabd::gateway::kuka
