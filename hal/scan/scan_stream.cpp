// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/scan_stream.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "base/thermal.h"
#include "hal/scan/scan_points.h"
#include "hal/system/crc32c.h"

// Problem: 60 MB arrive over a cable that may be pulled, from third-party software, and a scan assigned to the wrong
// request would pass an unmeasured slab. Idea: a fixed header names the request and carries checksums of itself and of
// all points. The number of points is compared with the buffer before one is stored. Invariants: points_ never exceeds
// header_.count, which never exceeds the buffer. complete() requires the checksum over all points in the buffer, even
// if they came over several connections.
namespace slabd::hal {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they are on the wire");

constexpr std::array<char, 8> kMagic = {'S', 'L', 'A', 'B', 'S', 'C', 'A', 'N'};

/// Byte offsets; docs/DELIVERY.md contains the same table.
enum At : std::size_t {
  kAtMagic = 0,
  kAtVersion = 8,
  kAtHeaderBytes = 10,
  kAtSession = 12,
  kAtCmdSeq = 14,
  kAtWidth = 16,
  kAtHeight = 20,
  kAtCount = 24,
  kAtFirst = 28,
  kAtUnit = 32,
  kAtFlags = 36,
  kAtUtime = 40,
  kAtPointsCrc = 48,
  kAtScanner = 52,
  kAtHeaderCrc = 60,
};

constexpr std::uint32_t kFlagEmulated = 1;
constexpr std::uint32_t kFlagRefused = 2;
/// The upper 16 bits of the flags are the scanner's temperature, 0.01 K.
constexpr unsigned kTemperatureShift = 16;
constexpr std::uint32_t kFlagBits = (1U << kTemperatureShift) - 1U;
constexpr double kCentikelvin = 100.0;

constexpr std::uint16_t ck_of(double temperature_c) {
  return static_cast<std::uint16_t>((temperature_c + kKelvinAtZero_c) * kCentikelvin + 0.5);
}
constexpr std::uint16_t kTemperatureMin_ck = ck_of(kScannerTemperatureMin_c);
constexpr std::uint16_t kTemperatureMax_ck = ck_of(kScannerTemperatureMax_c);

template <typename Number>
Number get(std::span<const std::byte, kScanHeaderBytes> bytes, std::size_t at) {
  Number number{};
  std::memcpy(&number, &bytes[at], sizeof number);
  return number;
}
template <typename Number>
void put(ScanHeaderBytes& bytes, std::size_t at, Number number) {
  std::memcpy(&bytes[at], &number, sizeof number);
}

double mm_per(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::mm: return 1.0;
    case LengthUnit::m: return 1e3;
    case LengthUnit::um: return 1e-3;
  }
  return 1.0;
}

}  // namespace

std::uint16_t temperature_ck_of(double temperature_c) {
  const bool allowed = temperature_c >= kScannerTemperatureMin_c && temperature_c <= kScannerTemperatureMax_c;
  return allowed ? ck_of(temperature_c) : std::uint16_t{0};
}

double temperature_c_of(std::uint16_t temperature_ck) {
  return temperature_ck == 0 ? kNoValue : static_cast<double>(temperature_ck) / kCentikelvin - kKelvinAtZero_c;
}

ScanHeaderBytes encode_scan_header(const ScanStreamHeader& header) {
  ScanHeaderBytes bytes{};
  std::memcpy(&bytes[kAtMagic], kMagic.data(), kMagic.size());
  put(bytes, kAtVersion, kScanStreamVersion);
  put(bytes, kAtHeaderBytes, static_cast<std::uint16_t>(kScanHeaderBytes));
  put(bytes, kAtSession, header.session);
  put(bytes, kAtCmdSeq, header.cmd_seq);
  put(bytes, kAtWidth, header.width);
  put(bytes, kAtHeight, header.height);
  put(bytes, kAtCount, header.count);
  put(bytes, kAtFirst, header.first);
  put(bytes, kAtUnit, static_cast<std::uint32_t>(header.unit));
  put(bytes, kAtFlags,
      (header.emulated ? kFlagEmulated : 0U) | (header.refused ? kFlagRefused : 0U) |
          (std::uint32_t{header.temperature_ck} << kTemperatureShift));
  put(bytes, kAtUtime, header.utime_us);
  put(bytes, kAtPointsCrc, header.points_crc);
  put(bytes, kAtScanner, header.scanner);
  put(bytes, kAtHeaderCrc, crc32c(std::span(bytes).first(kAtHeaderCrc)));
  return bytes;
}

Result<ScanStreamHeader> decode_scan_header(std::span<const std::byte, kScanHeaderBytes> bytes) {
  if (std::memcmp(&bytes[kAtMagic], kMagic.data(), kMagic.size()) != 0)
    return error(Code::frame_incomplete, "scan header: bytes 0..7 are not SLABSCAN");
  if (const auto version = get<std::uint16_t>(bytes, kAtVersion); version != kScanStreamVersion)
    return error(Code::frame_incomplete, "scan header: version %u, known is %u", unsigned{version},
                 unsigned{kScanStreamVersion});
  if (const auto size = get<std::uint16_t>(bytes, kAtHeaderBytes); size != kScanHeaderBytes)
    return error(Code::frame_incomplete, "scan header: declares %u bytes, allowed are %zu", unsigned{size},
                 kScanHeaderBytes);
  const auto crc = get<std::uint32_t>(bytes, kAtHeaderCrc);
  if (const std::uint32_t found = crc32c(bytes.first<kAtHeaderCrc>()); crc != found)
    return error(Code::frame_incomplete, "scan header: CRC-32C 0x%08X, of bytes 0..59 it is 0x%08X", crc, found);
  ScanStreamHeader header;
  header.session = get<std::uint16_t>(bytes, kAtSession);
  header.cmd_seq = get<std::uint16_t>(bytes, kAtCmdSeq);
  header.width = get<std::uint32_t>(bytes, kAtWidth);
  header.height = get<std::uint32_t>(bytes, kAtHeight);
  header.count = get<std::uint32_t>(bytes, kAtCount);
  header.first = get<std::uint32_t>(bytes, kAtFirst);
  header.utime_us = get<std::uint64_t>(bytes, kAtUtime);
  header.points_crc = get<std::uint32_t>(bytes, kAtPointsCrc);
  const auto unit = get<std::uint32_t>(bytes, kAtUnit);
  if (unit > static_cast<std::uint32_t>(LengthUnit::um))
    return error(Code::frame_incomplete, "scan header: unit %u, allowed are 0 (mm), 1 (m), 2 (um)", unit);
  header.unit = static_cast<LengthUnit>(unit);
  const auto flags = get<std::uint32_t>(bytes, kAtFlags);
  if ((flags & kFlagBits & ~(kFlagEmulated | kFlagRefused)) != 0)
    return error(Code::frame_incomplete,
                 "scan header: flags 0x%08X; bits 2..15 of bytes 36..39 are reserved and must be 0", flags);
  header.temperature_ck = static_cast<std::uint16_t>(flags >> kTemperatureShift);
  if (const unsigned ck = header.temperature_ck; ck != 0 && (ck < kTemperatureMin_ck || ck > kTemperatureMax_ck))
    return error(
        Code::frame_incomplete,
        "scan header: scanner temperature %u in bytes 38..39 (unit 0.01 K); allowed are 0 (unknown) and %u..%u "
        "(%.0f..%.0f deg C)",
        ck, unsigned{kTemperatureMin_ck}, unsigned{kTemperatureMax_ck}, kScannerTemperatureMin_c,
        kScannerTemperatureMax_c);
  header.emulated = (flags & kFlagEmulated) != 0;
  header.refused = (flags & kFlagRefused) != 0;
  header.scanner = get<std::uint64_t>(bytes, kAtScanner);
  if (header.refused) {
    constexpr auto kLow = static_cast<std::uint32_t>(Code::scanner_offline);
    constexpr auto kHigh = static_cast<std::uint32_t>(Code::exposure);
    if (header.width < kLow || header.width > kHigh || header.height != 0 || header.first != 0 || header.count == 0 ||
        header.count > kRefusalBytesMax)
      return error(Code::frame_incomplete,
                   "scan header: a refusal with width %u, height %u, count %u, first %u; allowed are %u..%u (code), 0, "
                   "1..%zu (bytes of the reason), 0",
                   header.width, header.height, header.count, header.first, kLow, kHigh, kRefusalBytesMax);
    return header;
  }
  if (header.count == 0) return error(Code::too_few_points, "scan header: no points");
  const bool organised = header.width != 0 || header.height != 0;
  if (organised && std::uint64_t{header.width} * header.height != header.count)
    return error(Code::frame_incomplete, "scan header: width %u times height %u is not count %u", header.width,
                 header.height, header.count);
  if (header.first >= header.count)
    return error(Code::frame_incomplete, "scan header: first point %u of %u", header.first, header.count);
  return header;
}

void ScanStreamDecoder::expect(std::uint16_t session, std::uint16_t cmd_seq) {
  const std::span<float> xyz = xyz_;
  const std::uint32_t starts = starts_;
  *this = ScanStreamDecoder(xyz);
  starts_ = starts;
  session_ = session;
  cmd_seq_ = cmd_seq;
}

void ScanStreamDecoder::cut() {
  header_have_ = 0;
  torn_have_ = 0;
  in_points_ = false;
  in_reason_ = false;
  reason_.clear();
}

std::size_t ScanStreamDecoder::wanted() const {
  if (complete_ || refusal_complete_) return 0;
  if (in_reason_) return header_.count - reason_.size();
  if (!in_points_) return kScanHeaderBytes - header_have_;
  return (header_.count - points_) * kScanPointBytes - torn_have_;
}

Status ScanStreamDecoder::feed(std::span<const std::byte> bytes) {
  if (bytes.size() > wanted())
    return error(Code::frame_incomplete, "%zu bytes, but only %zu belong to the scan", bytes.size(), wanted());
  if (in_reason_) return take_reason(bytes);
  if (!in_points_) {
    if (bytes.empty()) return success();
    std::memcpy(&header_bytes_[header_have_], bytes.data(), bytes.size());
    header_have_ += bytes.size();
    return header_have_ == kScanHeaderBytes ? take_header() : success();
  }
  if (torn_have_ != 0) {
    const std::size_t more = std::min(bytes.size(), kScanPointBytes - torn_have_);
    std::memcpy(&torn_[torn_have_], bytes.data(), more);
    torn_have_ += more;
    bytes = bytes.subspan(more);
    if (torn_have_ < kScanPointBytes) return success();
    torn_have_ = 0;
    take_points(torn_);
  }
  const std::size_t whole = bytes.size() / kScanPointBytes * kScanPointBytes;
  take_points(bytes.first(whole));
  torn_have_ = bytes.size() - whole;
  if (torn_have_ != 0) std::memcpy(torn_.data(), &bytes[whole], torn_have_);
  return points_ == header_.count ? finish() : success();
}

Status ScanStreamDecoder::take_header() {
  header_have_ = 0;
  const Result<ScanStreamHeader> decoded = decode_scan_header(header_bytes_);
  if (!decoded) return decoded.error();
  const ScanStreamHeader& header = decoded.value();
  if (header.session != session_ || header.cmd_seq != cmd_seq_)
    return error(Code::frame_incomplete, "the scan answers request %u-%u, expected is %u-%u", unsigned{header.session},
                 unsigned{header.cmd_seq}, unsigned{session_}, unsigned{cmd_seq_});
  if (header.refused) {
    forget_points();
    header_ = header;
    in_reason_ = true;
    return success();
  }
  if (header.count > xyz_.size() / 3)
    return error(Code::frame_incomplete, "the scan has %u points, allowed are %zu", header.count, xyz_.size() / 3);
  if (header.first != 0) {
    // A restarted gateway has another scan. The present points cannot be completed, so the next request line contains
    // 0.
    if (!has_header_ || !header.same_scan(header_)) forget_points();
    if (header.first != points_)
      return error(Code::frame_incomplete, "the scan continues at point %u, but %zu of its points were received",
                   header.first, points_);
  } else {
    forget_points();
    ++starts_;
  }
  header_ = header;
  has_header_ = true;
  in_points_ = true;
  return success();
}

void ScanStreamDecoder::take_points(std::span<const std::byte> whole) {
  if (whole.empty()) return;
  const std::span<float> fresh = xyz_.subspan(3 * points_, whole.size() / sizeof(float));
  crc_ = crc32c(whole, crc_);
  std::memcpy(fresh.data(), whole.data(), whole.size());
  if (header_.unit != LengthUnit::mm) {
    const double factor = mm_per(header_.unit);
    for (float& v : fresh) v = coordinate_mm<float>(static_cast<double>(v), factor);
  }
  settled_ += settle_points(fresh);
  points_ += whole.size() / kScanPointBytes;
}

Status ScanStreamDecoder::take_reason(std::span<const std::byte> bytes) {
  crc_ = crc32c(bytes, crc_);
  for (const std::byte b : bytes) {
    const auto c = static_cast<char>(b);
    reason_.append(std::string_view(c >= ' ' && c <= '~' ? &c : "?", 1));
  }
  if (reason_.size() != header_.count) return success();
  const std::uint32_t found = crc_;
  if (found != header_.points_crc)
    return error(Code::frame_incomplete, "the reason of a refusal has CRC-32C 0x%08X, the header has 0x%08X", found,
                 header_.points_crc);
  refusal_ = error(static_cast<Code>(header_.width), "the gateway has no scan: %s", reason_.c_str());
  refusal_complete_ = true;
  in_reason_ = false;
  return success();
}

void ScanStreamDecoder::forget_points() {
  has_header_ = false;
  points_ = 0;
  settled_ = {};
  crc_ = 0;
}

Status ScanStreamDecoder::finish() {
  const std::uint32_t found = crc_;
  in_points_ = false;
  if (found != header_.points_crc) {
    forget_points();
    return error(Code::frame_incomplete, "the points have CRC-32C 0x%08X, the header has 0x%08X", found,
                 header_.points_crc);
  }
  complete_ = true;
  return success();
}

}  // namespace slabd::hal
