// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "base/result.h"

/// The scanner's side of a scan stream (docs/SCANNER.md): what a vendor's gateway does, as small as it can be. One
/// thread uses it.
namespace slabd::cli {

struct StreamRequest {
  std::uint16_t session = 0;
  std::uint16_t cmd_seq = 0;
  int station = 0;
  std::string slab_id;
  std::uint32_t have_points = 0;  ///< of a scan that was cut off: slabd has so many already
  [[nodiscard]] std::string name() const { return std::to_string(session) + "-" + std::to_string(cmd_seq); }
};

class StreamGateway {
 public:
  StreamGateway(std::string host, std::uint16_t port) : host_(std::move(host)), port_(port) {}

  /// Connects when there is no connection. scanner_offline: the daemon does not listen there.
  [[nodiscard]] Status connect();
  ~StreamGateway() { close(); }
  StreamGateway(const StreamGateway&) = delete;
  StreamGateway& operator=(const StreamGateway&) = delete;
  [[nodiscard]] bool connected() const { return fd_ >= 0; }
  /// The request that waits for a scan, at most `wait_ms` later. Other lines are passed over; `note` then has the last
  /// error slabd told. Nothing when the connection ended.
  [[nodiscard]] std::optional<StreamRequest> next_request(int wait_ms, std::string& note);
  /// Sends `xyz` (mm) as the answer and waits for slabd's word. scanner_offline: the connection was lost; connect again
  /// and slabd repeats the request with `have_points`; the scan goes on there if it is the one that this gateway began,
  /// and is sent as a whole otherwise. Other codes: slabd refused the scan. `emulated`: declared so. `cut_after_points`
  /// (tests): closes the connection there.
  [[nodiscard]] Status answer(const StreamRequest& request, std::span<const float> xyz, std::size_t width,
                              std::size_t height, std::int64_t utime_us, std::size_t cut_after_points = SIZE_MAX,
                              bool emulated = false);
  /// The point that the last answer went on from; 0: it was sent as a whole.
  [[nodiscard]] std::uint32_t went_on_from() const { return went_on_from_; }
  void close();

 private:
  [[nodiscard]] std::optional<std::string> next_line(int wait_ms);
  [[nodiscard]] bool send_all(std::span<const std::byte> bytes);

  std::string host_;
  std::uint16_t port_;
  int fd_ = -1;
  std::string text_;           ///< read and not yet taken
  std::string begun_;          ///< name of the request whose scan was sent last, or a part of it ...
  std::int64_t utime_us_ = 0;  ///< ... and that scan's time
  std::uint32_t went_on_from_ = 0;
};

}  // namespace slabd::cli
