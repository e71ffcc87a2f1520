// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "base/items.h"
#include "base/os.h"
#include "base/result.h"

/// The scanner's side of a scan stream (docs/DELIVERY.md): the smallest form of a vendor's gateway. Used by one thread.
namespace slabd::emulator {

struct StreamRequest {
  std::uint16_t session = 0;
  std::uint16_t cmd_seq = 0;
  int station = 0;
  std::string slab_id;
  std::uint32_t have_points = 0;  ///< points of an interrupted scan that slabd already has
  int gateway = 1;                ///< optional fields that slabd accepts (hal/scan/scan_stream.h)
  [[nodiscard]] std::string name() const { return std::to_string(session) + "-" + std::to_string(cmd_seq); }
};

class StreamGateway {
 public:
  StreamGateway(std::string host, std::uint16_t port) : host_(std::move(host)), port_(port) {}

  /// Connects if not connected. Code::scanner_offline if the daemon does not listen.
  [[nodiscard]] Status connect();
  [[nodiscard]] bool connected() const { return socket_.is_open(); }
  /// Waits at most `wait_ms` for a request. Other lines are skipped; `note` then contains slabd's last error. nullopt
  /// if none came or the connection ended.
  [[nodiscard]] std::optional<StreamRequest> next_request(int wait_ms, std::string& note);
  /// Sends `xyz` (mm) as the answer and waits for slabd's reply. Code::scanner_offline: the connection was lost; after
  /// a reconnect slabd repeats the request with `have_points`. The scan continues there if this gateway began it, and
  /// is sent as a whole otherwise. Other codes: slabd rejected the scan. `emulated`: declares the scan as emulated.
  /// `cut_after_points` (tests): closes the connection there. `temperature_c`: of the scanner, sent if slabd accepts
  /// it.
  [[nodiscard]] Status answer(const StreamRequest& request, std::span<const float> xyz, std::size_t width,
                              std::size_t height, std::int64_t utime_us, std::size_t cut_after_points = SIZE_MAX,
                              bool emulated = false, double temperature_c = kNoValue);
  /// First point sent by the last answer; 0: the whole scan was sent.
  [[nodiscard]] std::uint32_t resumed_from() const { return resumed_from_; }
  void close();

 private:
  [[nodiscard]] std::optional<std::string> next_line(int wait_ms);
  [[nodiscard]] bool send_all(std::span<const std::byte> bytes);

  std::string host_;
  std::uint16_t port_;
  Fd socket_;
  std::string text_;           ///< received and not yet parsed
  std::string begun_;          ///< name of the request whose scan was last sent, whole or in part
  std::int64_t utime_us_ = 0;  ///< time of that scan
  std::uint32_t resumed_from_ = 0;
};

}  // namespace slabd::emulator
