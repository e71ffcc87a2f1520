// SPDX-License-Identifier: Apache-2.0
//
// slabd-kuka-bridge: publishes the poses that a KUKA controller sends over RSI as slabd.flange_pose_t over LCM. It
// never answers the controller (RSI with ONLYSEND), so it cannot move or stop the robot.
#include <arpa/inet.h>
#include <fmt/core.h>
#include <lcm/lcm.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <climits>
#include <csignal>
#include <cstring>
#include <slabd/flange_pose_t.hpp>
#include <thread>
#include <vector>

#include "base/os.h"
#include "base/rate_limit.h"
#include "gateway/kuka/rsi.h"

namespace slabd::gateway::kuka {
namespace {

constexpr int kExitUsage = 2;
constexpr int kExitBadInput = 3;
constexpr int kExitUnreachable = 4;
constexpr std::int64_t kSilence_ns = kNsPerS;
constexpr std::int64_t kReportPeriod_ns = 60 * kNsPerS;

std::int64_t steady_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::atomic<bool> g_stop{false};
void on_signal(int) {
  g_stop = true;
}

struct Options {
  std::string listen = "0.0.0.0:49152";
  std::string from;
  std::string lcm_url = "udpm://239.255.76.67:7667?ttl=0";
  std::string channel = "FLANGE_POSE";
  BridgeSettings settings;
};

/// Writes one line to stderr; the journal adds the time.
template <typename... Args>
void say(const char* format, const Args&... args) {
  const std::string line = fmt::format(fmt::runtime(format), args...) + "\n";
  // A blocked journal must not delay the poses: a line may be lost.
  if (::send(STDERR_FILENO, line.data(), line.size(), MSG_DONTWAIT | MSG_NOSIGNAL) < 0 && errno == ENOTSOCK)
    fmt::print(stderr, "{}", line);
}

/// Parses the whole text as a number in the range.
bool whole_number(std::string_view text, long low, long high, long& number) {
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), number);
  return fault == std::errc() && end == text.data() + text.size() && number >= low && number <= high;
}

bool parse_listen(std::string_view text, sockaddr_in& address) {
  const std::size_t colon = text.rfind(':');
  long port = 0;
  if (colon == std::string_view::npos || !whole_number(text.substr(colon + 1), 1, 65'535, port)) return false;
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  return ::inet_pton(AF_INET, std::string(text.substr(0, colon)).c_str(), &address.sin_addr) == 1;
}

/// True if the URL is that of a multicast group. liblcm accepts other URLs and ignores unknown options, and its error
/// does not distinguish a wrong address from a missing route.
bool is_lcm_url(std::string_view url) {
  constexpr std::string_view kScheme = "udpm://";
  if (url.substr(0, kScheme.size()) != kScheme) return false;
  url.remove_prefix(kScheme.size());
  const std::size_t query = url.find('?');
  sockaddr_in group{};
  if (!parse_listen(url.substr(0, query), group) || !IN_MULTICAST(ntohl(group.sin_addr.s_addr))) return false;
  std::string_view options = query == std::string_view::npos ? "" : url.substr(query + 1);
  while (!options.empty()) {
    const std::string_view option = options.substr(0, options.find('&'));
    options.remove_prefix(std::min(options.size(), option.size() + 1));
    const std::string_view name = option.substr(0, option.find('='));
    const std::string_view value = option.substr(std::min(option.size(), name.size() + 1));
    long number = 0;
    if (name != "ttl" && name != "recv_buf_size") return false;
    if (!whole_number(value, 0, name == "ttl" ? 255 : INT_MAX, number)) return false;
  }
  return true;
}

std::string dotted(std::uint32_t address) {
  return fmt::format("{}.{}.{}.{}", address >> 24U, (address >> 16U) & 255U, (address >> 8U) & 255U, address & 255U);
}

/// Opens the receiving socket; none and a logged message on failure.
Fd open_socket(const sockaddr_in& address, const std::string& listen) {
  Fd fd(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (!fd.is_open() ||
      ::bind(fd.get(), static_cast<const sockaddr*>(static_cast<const void*>(&address)), sizeof address) != 0) {
    say("error: {}: {}; does another program listen there, is it an address of this computer?", listen,
        std::strerror(errno));
    return {};
  }
  return fd;
}

flange_pose_t message_of(const FlangePose& pose) {
  flange_pose_t message{};
  message.utime =
      std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
          .count();
  message.robot_time_us = pose.robot_time_us;
  message.seq = pose.seq;
  message.base_id = pose.base_id;
  message.tool_id = pose.tool_id;
  message.flags = pose.flags;
  for (int axis = 0; axis < 3; ++axis) message.trans[axis] = m_from_mm(pose.T_base_flange.translation_mm[axis]);
  const Quat& q = pose.T_base_flange.rotation;
  message.quat[0] = q.w(), message.quat[1] = q.x(), message.quat[2] = q.y(), message.quat[3] = q.z();
  return message;
}

class Publisher {
 public:
  explicit Publisher(const Options& options) : options_(options) {}
  ~Publisher() {
    if (lcm_ != nullptr) lcm_destroy(lcm_);
  }
  Publisher(const Publisher&) = delete;
  Publisher& operator=(const Publisher&) = delete;

  /// Opens LCM, which requires a route for the group: retries until there is one or the process is stopped.
  bool open() {
    for (bool said = false; !g_stop && lcm_ == nullptr;) {
      lcm_ = lcm_create(options_.lcm_url.c_str());
      if (lcm_ != nullptr) break;
      if (!said)
        say("no route for the multicast group of {}; ip route add GROUP/32 dev INTERFACE; trying on", options_.lcm_url);
      said = true;
      for (int i = 0; i < 10 && !g_stop; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    return lcm_ != nullptr;
  }
  /// False if the pose was not sent; errno contains the reason.
  [[nodiscard]] bool publish(const FlangePose& pose) {
    const flange_pose_t message = message_of(pose);
    wire_.resize(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(wire_.data(), 0, static_cast<int>(wire_.size()));
    return lcm_publish(lcm_, options_.channel.c_str(), wire_.data(), static_cast<unsigned>(wire_.size())) == 0;
  }
  /// Publishes the reason for missing poses, for the status of slabd (hal/robot/lcm_wire.h, bridge_word_on).
  void publish_word(std::string_view text) {
    const std::string channel = options_.channel + "_WORD";
    (void)lcm_publish(lcm_, channel.c_str(), text.data(), static_cast<unsigned>(text.size()));
  }

 private:
  const Options& options_;
  lcm_t* lcm_ = nullptr;
  std::vector<std::uint8_t> wire_;
};

/// Rate-limited log of the link: a robot sends 250 packets a second.
class Voice {
 public:
  explicit Voice(Publisher& publisher) : publisher_(publisher) {
    // The first words and the first report come after a period.
    (void)words_.permits(heard_ns_);
    (void)reports_.permits(heard_ns_);
  }
  void heard(const std::string& sender, bool is_new) {
    if (silent_ || is_new) say("packets arrive from {}", sender);
    silent_ = false;
    heard_ns_ = steady_ns();
  }
  void malformed(const Error& why) {
    const std::int64_t now_ns = steady_ns();
    if (!complaints_.permits(now_ns)) return;
    complained_ns_ = now_ns;
    say("{}", why.text.view());
    publisher_.publish_word(why.text.view());
  }
  /// Logs a rejected packet and the reason.
  void dropped(const std::string& sender, const std::string& why) {
    const std::int64_t now_ns = steady_ns();
    const std::string sentence = fmt::format("packets of {} are dropped: {}", sender, why);
    if (words_.permits(now_ns)) publisher_.publish_word(sentence);
    if (drops_.permits(now_ns)) say("{}", sentence);
  }
  /// Logs whether poses are sent, because slabd cannot detect the reason for missing poses. `error`: errno of the
  /// failed send.
  void published(bool sent, int error) {
    const std::int64_t now_ns = steady_ns();
    if (!sent) {
      ++unsent_;
      unsent_ns_ = now_ns;
      if (sending_)
        say("poses cannot be published: {}; is the network up, has the multicast group a route? trying on",
            std::strerror(error));
      sending_ = false;
    } else if (!sending_ && now_ns - unsent_ns_ > kSilence_ns) {
      sending_ = true;
      say("poses are published again");
    }
  }
  void look(const BridgeCounters& counters, std::uint64_t not_believed) {
    const std::int64_t now_ns = steady_ns();
    if (!silent_ && now_ns - heard_ns_ > kSilence_ns) {
      silent_ = true;
      say("no packets for a second: is RSI on, is the network up?");
    }
    if (silent_ && now_ns - complained_ns_ >= 2 * kSilence_ns && words_.permits(now_ns))
      publisher_.publish_word("no RSI packets from a controller");
    if (!reports_.permits(now_ns)) return;
    say("{} poses published, {} not sent, {} malformed, {} old, {} lost, {} restarts, {} from others or while two sent",
        counters.published - unsent_, unsent_, counters.malformed, counters.old, counters.lost, counters.restarts,
        not_believed);
  }

 private:
  Publisher& publisher_;
  bool silent_ = true;
  bool sending_ = true;
  std::uint64_t unsent_ = 0;
  std::int64_t unsent_ns_ = 0;
  std::int64_t heard_ns_ = steady_ns();
  std::int64_t complained_ns_ = heard_ns_ - kSilence_ns;
  RateLimit complaints_{kSilence_ns};
  RateLimit drops_{kReportPeriod_ns};
  RateLimit words_{kSilence_ns};
  RateLimit reports_{kReportPeriod_ns};
};

int bridge(const Options& options) {
  sockaddr_in address{};
  in_addr from{};
  if (!parse_listen(options.listen, address)) {
    say("error: --listen {}: expected ADDRESS:PORT, such as 192.168.10.2:49152", options.listen);
    return kExitBadInput;
  }
  if (!options.from.empty() && ::inet_pton(AF_INET, options.from.c_str(), &from) != 1) {
    say("error: --from {}: expected the controller's IPv4 address", options.from);
    return kExitBadInput;
  }
  if (!is_lcm_url(options.lcm_url)) {
    say("error: --lcm-url {}: expected udpm://GROUP:PORT?ttl=N, such as udpm://239.255.76.67:7667?ttl=0; allowed are "
        "groups from 224.0.0.0 to 239.255.255.255, ports 1 to 65535, ttl 0 to 255",
        options.lcm_url);
    return kExitBadInput;
  }
  const Fd fd = open_socket(address, options.listen);
  if (!fd.is_open()) return kExitUnreachable;
  Publisher publisher(options);
  if (!publisher.open()) return 0;
  say("RSI on {} -> {} on {}", options.listen, options.channel, options.lcm_url);

  Bridge translator(options.settings);
  Senders senders;
  Voice voice(publisher);
  std::uint64_t not_believed = 0;
  std::array<char, kRsiBytesMax + 1> buffer{};
  while (!g_stop) {
    pollfd waiting{fd.get(), POLLIN, 0};
    const int ready = ::poll(&waiting, 1, 200);
    voice.look(translator.counters(), not_believed);
    if (ready <= 0) continue;
    sockaddr_in sender{};
    socklen_t size = sizeof sender;
    const ssize_t got = ::recvfrom(fd.get(), buffer.data(), buffer.size(), 0,
                                   static_cast<sockaddr*>(static_cast<void*>(&sender)), &size);
    if (got < 0) continue;
    const std::uint32_t from_address = ntohl(sender.sin_addr.s_addr);
    const std::string name = fmt::format("{}:{}", dotted(from_address), ntohs(sender.sin_port));
    if (!options.from.empty() && sender.sin_addr.s_addr != from.s_addr) {
      ++not_believed;
      voice.dropped(name, "--from names another controller");
      continue;
    }
    const Result<RsiPacket> packet = parse_rsi(std::string_view(buffer.data(), static_cast<std::size_t>(got)));
    if (!packet) {
      translator.count_malformed();
      voice.malformed(packet.error());
      continue;
    }
    const Senders::Answer who = senders.hear(from_address, steady_ns());
    voice.heard(name, who == Senders::Answer::other);
    if (who == Senders::Answer::two) {
      ++not_believed;
      voice.dropped(name, fmt::format("{} sends as well, and it is unknown which one is the robot; name it with --from",
                                      dotted(senders.other_than(from_address))));
      continue;
    }
    if (who == Senders::Answer::other) translator.restart();
    const auto pose = translator.translate(packet.value());
    if (!pose) continue;
    const bool sent = publisher.publish(*pose);
    voice.published(sent, errno);
  }
  return 0;
}

}  // namespace
}  // namespace slabd::gateway::kuka

// The only exception that escapes is lack of memory at the start: it ends the process, and the service manager
// restarts it.
int main(int argc, char** argv) {  // NOLINT(bugprone-exception-escape)
  using namespace slabd::gateway::kuka;
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);

  Options options;
  CLI::App app("Publishes what a KUKA controller sends over RSI (ONLYSEND) as flange poses for slabd");
  app.footer(
      "\nSet up on the robot: docs/ROBOT.md.\nExample: slabd-kuka-bridge --listen 192.168.10.2:49152 --from "
      "192.168.10.1");
  app.add_option("--listen", options.listen, "Address and port that the controller sends to")->capture_default_str();
  app.add_option("--from", options.from,
                 "The controller's address; packets of others are dropped. "
                 "Without it: while two send, neither is used");
  app.add_option("--cycle-ms", options.settings.cycle_ms, "RSI's cycle: 4 (IPO_FAST) or 12")
      ->check(CLI::IsMember({4, 12}))
      ->capture_default_str();
  app.add_option("--lcm-url", options.lcm_url, "As [robot] lcm_url of slabd")->capture_default_str();
  app.add_option("--channel", options.channel, "As [robot] channel of slabd")->capture_default_str();
  app.add_option("--base", options.settings.base_id, "$ACT_BASE where the packets have no <Base>")
      ->check(CLI::Range(0, 32))
      ->capture_default_str();
  app.add_option("--tool", options.settings.tool_id, "$ACT_TOOL where the packets have no <Tool>")
      ->check(CLI::Range(0, 16))
      ->capture_default_str();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& fault) {
    const int status = app.exit(fault);
    return status == 0 ? 0 : kExitUsage;
  }
  return bridge(options);
}
