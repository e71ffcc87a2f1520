// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "hal/hal.h"
#include "hal/scan/scan_points.h"
#include "hal/system/crc32c.h"

/// Scans as a stream of bytes, as a gateway sends them over TCP (docs/DELIVERY.md). One scan is a header of 64
/// bytes and `count - first` points of three float32, x y z, all little-endian. Pure: no socket, no file, no clock.
namespace slabd::hal {

inline constexpr std::size_t kScanHeaderBytes = 64;
inline constexpr std::size_t kScanPointBytes = 3 * sizeof(float);
inline constexpr std::uint16_t kScanStreamVersion = 1;
/// Longest reason of a refusal: with slabd's own words it fits an error's text.
inline constexpr std::size_t kRefusalBytesMax = 240;

/// Value of "gateway" in a request: the optional fields that this slabd accepts. 2: refusals and the scanner's print;
/// 3: also the scanner's temperature.
inline constexpr int kGatewayExtended = 2;
inline constexpr int kGatewayTemperature = 3;
inline constexpr int kGatewayNow = kGatewayTemperature;

/// ScanStreamHeader::temperature_ck for a temperature; 0 if it is NaN or outside the allowed range.
[[nodiscard]] std::uint16_t temperature_ck_of(double temperature_c);
/// The reverse; NaN for 0.
[[nodiscard]] double temperature_c_of(std::uint16_t temperature_ck);

/// Print of a scanner's identity (model, serial number, firmware, settings): FNV-1a, 64 bits, of its UTF-8 text. It
/// distinguishes scanners that are confused, not forged ones. 0 only for an empty text.
[[nodiscard]] constexpr std::uint64_t scanner_print(std::string_view identity) {
  if (identity.empty()) return 0;
  std::uint64_t print = 0xCBF2'9CE4'8422'2325U;
  for (const char c : identity) print = (print ^ static_cast<unsigned char>(c)) * 0x100'0000'01B3U;
  return print == 0 ? 1 : print;
}

struct ScanStreamHeader {
  std::uint16_t session = 0;
  std::uint16_t cmd_seq = 0;
  std::uint32_t width = 0;  ///< 0 with height 0: not organised
  std::uint32_t height = 0;
  std::uint32_t count = 0;  ///< points of the whole scan
  std::uint32_t first = 0;  ///< index of the first point that follows: 0, or the number that slabd has already
  LengthUnit unit = LengthUnit::mm;
  std::uint64_t utime_us = 0;    ///< end of the exposure by the sender's clock: for records and to recognise a scan
  std::uint32_t points_crc = 0;  ///< CRC-32C of all `count` points as they are sent
  bool emulated = false;         ///< bit 0 of the flags: the scanner is not real
  /// Bit 1 of the flags: the gateway has no scan for the request. Then `width` is the code of the error, 301 to 304,
  /// and `count` the number of bytes of its reason, which follow instead of points; `points_crc` is theirs. Only if the
  /// request had "gateway": 2 or more, as a scanner print.
  bool refused = false;
  std::uint64_t scanner = 0;  ///< scanner_print() of the scanner; 0: not stated
  /// Temperature of the scanner during the exposure, 0.01 K, in the upper 16 bits of the flags; 0: not stated. Only if
  /// the request had "gateway": 3.
  std::uint16_t temperature_ck = 0;

  /// True for the same scan, whatever point it continues from.
  [[nodiscard]] bool same_scan(const ScanStreamHeader& other) const {
    return session == other.session && cmd_seq == other.cmd_seq && width == other.width && height == other.height &&
           count == other.count && unit == other.unit && utime_us == other.utime_us && points_crc == other.points_crc &&
           emulated == other.emulated && refused == other.refused && scanner == other.scanner &&
           temperature_ck == other.temperature_ck;
  }
};

using ScanHeaderBytes = std::array<std::byte, kScanHeaderBytes>;
[[nodiscard]] ScanHeaderBytes encode_scan_header(const ScanStreamHeader& header);
/// frame_incomplete: the text names the field, its value and the allowed values.
[[nodiscard]] Result<ScanStreamHeader> decode_scan_header(std::span<const std::byte, kScanHeaderBytes> bytes);

/// Decodes one scan, piece by piece, across losses of the connection. No heap.
///
///   expect(session, seq) -> feed() ... feed() -> complete()
///                             ^           |
///                             +-- cut() <-+   the next header may continue from points()
class ScanStreamDecoder {
 public:
  /// `xyz` receives the points in mm; a scan with more points than fit is rejected at its header.
  explicit ScanStreamDecoder(std::span<float> xyz) : xyz_(xyz) {}

  /// Starts waiting for the answer to a request; discards earlier data.
  void expect(std::uint16_t session, std::uint16_t cmd_seq);
  /// The connection was lost: a header follows next. Complete points are kept.
  void cut();
  /// Number of bytes that may be given to feed() now: of the header or of the points; 0 if the scan is complete.
  [[nodiscard]] std::size_t wanted() const;
  /// Decodes `bytes`, at most wanted(). frame_incomplete if this is not the requested scan, or it is damaged (a
  /// checksum); the connection must be closed. Points are discarded after a wrong checksum, or if another scan of the
  /// same request tries to continue this one.
  [[nodiscard]] Status feed(std::span<const std::byte> bytes);

  [[nodiscard]] bool complete() const { return complete_; }
  /// The gateway's error if it has no scan for the request; nullptr otherwise.
  [[nodiscard]] const Error* refusal() const { return refusal_complete_ ? &refusal_ : nullptr; }
  /// True if part of a scan has arrived on this connection.
  [[nodiscard]] bool is_in_scan() const { return !complete_ && (in_points_ || header_have_ != 0); }
  [[nodiscard]] bool has_header() const { return has_header_; }
  [[nodiscard]] const ScanStreamHeader& header() const { return header_; }
  /// Number of points in `xyz`, in mm, NaN in all three coordinates of a missing one.
  [[nodiscard]] std::size_t points() const { return points_; }
  /// Points from index `from` on, in `xyz`.
  [[nodiscard]] std::span<const float> fresh(std::size_t from) const {
    return xyz_.subspan(3 * from, 3 * (points_ - from));
  }
  [[nodiscard]] std::size_t finite() const { return settled_.finite; }
  [[nodiscard]] ScanShape shape() const {
    ScanShape shape{points_, settled_.finite, header_.width, header_.height, true, settled_.zeros, header_.emulated};
    shape.scanner_temperature_c = temperature_c_of(header_.temperature_ck);
    return shape;
  }
  /// Number of scans that began with their first point; a copy of the points must restart when it changes.
  [[nodiscard]] std::uint32_t starts() const { return starts_; }

 private:
  Status take_header();
  void take_points(std::span<const std::byte> whole);
  Status take_reason(std::span<const std::byte> bytes);
  Status finish();
  void forget_points();

  std::span<float> xyz_;
  std::uint16_t session_ = 0;
  std::uint16_t cmd_seq_ = 0;
  ScanHeaderBytes header_bytes_{};
  std::size_t header_have_ = 0;  ///< bytes of an incomplete header
  bool in_points_ = false;       ///< the header is complete, points follow
  bool has_header_ = false;      ///< `header_` and `points_` are of a scan that may be continued
  bool complete_ = false;
  bool in_reason_ = false;  ///< the header of a refusal is complete, its reason follows
  bool refusal_complete_ = false;
  FixedString<kRefusalBytesMax> reason_;
  Error refusal_;
  ScanStreamHeader header_;
  std::array<std::byte, kScanPointBytes> torn_{};  ///< an incomplete point
  std::size_t torn_have_ = 0;
  std::size_t points_ = 0;
  Settled settled_;
  std::uint32_t crc_ = 0;
  std::uint32_t starts_ = 0;
};

}  // namespace slabd::hal
