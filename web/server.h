// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "base/result.h"
#include "web/site.h"

struct MHD_Daemon;

/// HTTP listener (libmicrohttpd). Each connection has a thread, because an answer may wait for slabctl: a waiting
/// browser then stops no other one. The limit of connections limits the threads.
namespace slabd::web {

inline constexpr unsigned kConnectionsMax = 64;
inline constexpr unsigned kConnectionBytesMax = 32'768;  ///< request line and fields
inline constexpr unsigned kIdle_s = 10;                  ///< for a request, and between two requests

struct ListenerSettings {
  std::string host;  ///< IPv4 address
  std::uint16_t port = 0;
  unsigned per_address_max = 16;
  bool is_tls = false;
  bool waits_for_address = false;  ///< opens although this computer does not have the address yet
  std::string certificate{};       ///< PEM; used with TLS only, as the key
  std::string key{};               ///< PEM
};

class Listener {
 public:
  /// `site` must live longer. With waits_for_address, an address that this computer does not have yet opens, too, and
  /// is reachable as soon as the computer has it. Code::config: the address is in use, or certificate and key are not
  /// usable.
  [[nodiscard]] static Result<std::unique_ptr<Listener>> open(const ListenerSettings& settings, Site& site);
  /// Closes all connections. Documents must have been stopped, because their waiting threads are joined.
  ~Listener();
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  [[nodiscard]] std::uint16_t port() const { return port_; }
  /// False if this computer did not have the address when the listener was opened.
  [[nodiscard]] bool has_address() const { return has_address_; }

  struct Context {
    Site& site;
    bool is_tls = false;
  };

 private:
  Listener(const ListenerSettings& settings, Site& site) : settings_(settings), context_{site, settings.is_tls} {}

  const ListenerSettings settings_;
  Context context_;
  std::uint16_t port_ = 0;
  bool has_address_ = true;
  MHD_Daemon* daemon_ = nullptr;
};

}  // namespace slabd::web
