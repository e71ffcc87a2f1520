// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "base/os.h"
#include "base/result.h"
#include "gateway/genicam/camera.h"

/// Connection to slabd: the gateway's side of the scan stream (docs/DELIVERY.md). Used by one thread; bounded waits.
namespace slabd::gateway::genicam {

/// slabd.scan_request/1.
struct Request {
  std::uint16_t session = 0;
  std::uint16_t cmd_seq = 0;
  bool extended = false;          ///< slabd accepts refusals and the scanner's print
  bool temperature = false;       ///< slabd accepts the scanner's temperature
  std::uint32_t have_points = 0;  ///< points of an interrupted scan that slabd already has
  std::int64_t timeout_ns = 0;    ///< for exposure and transfer
  std::string slab_id;
  int station = 0;
  [[nodiscard]] std::string name() const { return std::to_string(session) + "-" + std::to_string(cmd_seq); }
};

class Link {
 public:
  Link(std::string host, std::uint16_t port) : host_(std::move(host)), port_(port) {}

  /// Connects if not connected; waits at most kConnect_ms. scanner_offline: slabd does not listen.
  [[nodiscard]] Status connect();
  [[nodiscard]] bool connected() const { return socket_.is_open(); }
  /// Waits at most `wait_ms` for a line. nullopt if none came, it is not a request, or the connection ended. `note`
  /// receives slabd's answer if it rejected a scan.
  [[nodiscard]] std::optional<Request> next_request(int wait_ms, std::string& note);
  /// Sends the scan from point `first` on, without waiting for the answer. scanner_offline: the connection was lost or
  /// slabd did not take the bytes until `until_ns` (steady clock); after a reconnect slabd repeats the request.
  /// `scanner`: the camera's identity.
  [[nodiscard]] Status send(const Request& request, const Shot& shot, std::span<const float> xyz, std::uint32_t first,
                            const std::string& scanner, bool emulated, std::int64_t until_ns);
  /// Ends the request with the reason why there is no scan. A slabd that does not accept refusals ends it by its
  /// timeout.
  [[nodiscard]] Status refuse(const Request& request, const Error& why, std::int64_t until_ns);
  void close();

 private:
  [[nodiscard]] bool send_all(std::span<const std::byte> bytes, std::int64_t until_ns);

  std::string host_;
  std::uint16_t port_;
  Fd socket_;
  std::string text_;  ///< received and not yet parsed
};

}  // namespace slabd::gateway::genicam
