// SPDX-License-Identifier: Apache-2.0
//
// A scan over TCP, in pieces, interrupted, resumed and damaged according to the input:
//
//   0        bit 0: one byte is changed in transit, bit 1: the header is from the input, with a correct checksum,
//            bit 2: after a cut the sender restarts the scan instead of continuing
//   1, 2     width and height of the grid; another number of points than width * height: not organised
//   3        unit
//   4..7     position of the changed byte (three bytes), and the change
//   8        number of pieces; then one byte each: the size of the piece, and (bit 7) a cut of the link after it
//   rest     the points; with bit 1 the header and the points
#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <vector>

#include "hal/scan/scan_stream.h"
#include "hal/system/crc32c.h"
#include "tests/fuzz/fuzz.h"

using namespace slabd;       // NOLINT(google-build-using-namespace)
using namespace slabd::hal;  // NOLINT(google-build-using-namespace)

namespace {

constexpr std::size_t kPointsMax = 2'000;
constexpr std::size_t kPlanBytes = 9;
constexpr std::uint16_t kSession = 7;
constexpr std::uint16_t kCmdSeq = 3;

using Bytes = std::vector<std::byte>;

/// Feeds a heap block of exactly the piece's size, so that a sanitizer detects reads beyond it. False: rejected.
bool feed(ScanStreamDecoder& decoder, std::span<const std::byte> piece) {
  const auto exact = std::make_unique<std::byte[]>(piece.size());
  std::copy(piece.begin(), piece.end(), exact.get());
  const Status status = decoder.feed({exact.get(), piece.size()});
  fuzz::must(status.ok() || !status.error().text.empty(), "a refusal says why");
  fuzz::must(decoder.points() <= kPointsMax, "the points fit");
  fuzz::must(decoder.finite() <= decoder.points(), "finite ones are points");
  fuzz::must(status.ok() || !decoder.complete(), "what is refused is not complete");
  return status.ok();
}

/// Feeds at most `size` of `bytes` and at most what the decoder requests, in one piece; 0: it requests no more.
std::size_t feed_some(ScanStreamDecoder& decoder, std::span<const std::byte> bytes, std::size_t size, bool& refused) {
  const std::size_t n = std::min({bytes.size(), size, decoder.wanted()});
  if (n != 0 && !feed(decoder, bytes.first(n))) refused = true;
  return n;
}

/// Checks a complete scan.
void check_complete(const ScanStreamDecoder& decoder, std::span<const float> xyz) {
  const ScanStreamHeader& header = decoder.header();
  const ScanShape shape = decoder.shape();
  fuzz::must(header.session == kSession && header.cmd_seq == kCmdSeq, "a scan answers the request");
  fuzz::must(shape.points == header.count && decoder.points() == header.count, "a complete scan has all its points");
  fuzz::must(shape.width * shape.height == 0 || shape.width * shape.height == shape.points, "an organised scan too");
  fuzz::must(decoder.wanted() == 0, "a complete scan wants nothing more");
  std::size_t finite = 0;
  for (std::size_t i = 0; i < shape.points; ++i) {
    const auto of = [&](std::size_t axis) { return xyz[3 * i + axis]; };
    const bool all = std::isfinite(of(0)) && std::isfinite(of(1)) && std::isfinite(of(2));
    fuzz::must(all || (std::isnan(of(0)) && std::isnan(of(1)) && std::isnan(of(2))), "a point is there or missing");
    finite += all ? 1U : 0U;
  }
  fuzz::must(finite == decoder.finite(), "finite points are counted right");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < kPlanBytes) return 0;
  const bool damaged = (data[0] & 1U) != 0;
  const bool own_header = (data[0] & 2U) != 0;
  const bool begins_again = (data[0] & 4U) != 0;
  const std::size_t pieces = std::min<std::size_t>(data[8], size - kPlanBytes);
  const auto rest = std::as_bytes(std::span(data, size)).subspan(kPlanBytes + pieces);

  ScanStreamHeader header;
  ScanHeaderBytes first_header{};
  std::span<const std::byte> points = rest;
  if (own_header) {
    if (rest.size() < kScanHeaderBytes) return 0;
    std::copy_n(rest.begin(), kScanHeaderBytes, first_header.begin());
    const std::uint32_t crc = crc32c(std::span(first_header).first(kScanHeaderBytes - sizeof(std::uint32_t)));
    std::memcpy(&first_header[kScanHeaderBytes - sizeof crc], &crc, sizeof crc);
    points = rest.subspan(kScanHeaderBytes);
  } else {
    const std::size_t count = std::min(rest.size() / kScanPointBytes, kPointsMax);
    points = rest.first(count * kScanPointBytes);
    header = {kSession, kCmdSeq, data[1], data[2], static_cast<std::uint32_t>(count), 0, LengthUnit::mm, 1, 0};
    if (std::size_t{header.width} * header.height != count) header.width = header.height = 0;
    header.unit = static_cast<LengthUnit>(data[3] % 3);
    header.points_crc = crc32c(points);
    first_header = encode_scan_header(header);
  }
  Bytes sent(first_header.begin(), first_header.end());
  sent.insert(sent.end(), points.begin(), points.end());
  const std::size_t changed_at =
      (static_cast<std::size_t>(data[4]) << 16U | static_cast<std::size_t>(data[5]) << 8U | data[6]) % sent.size();
  const bool changed = damaged && data[7] != 0;
  if (changed) sent[changed_at] ^= std::byte{data[7]};

  std::vector<float> xyz(3 * kPointsMax);
  ScanStreamDecoder decoder(xyz);
  decoder.expect(kSession, kCmdSeq);
  bool refused = false;
  std::span<const std::byte> left = sent;
  Bytes resumed;
  for (std::size_t i = 0; i < pieces && !refused && !decoder.complete(); ++i) {
    const std::uint8_t plan = data[kPlanBytes + i];
    left = left.subspan(feed_some(decoder, left, 1U + (plan & 127U), refused));
    if ((plan & 128U) == 0 || own_header || refused || decoder.complete()) continue;
    decoder.cut();
    ScanStreamHeader again = header;
    again.first = begins_again ? 0 : static_cast<std::uint32_t>(decoder.points());
    const ScanHeaderBytes bytes = encode_scan_header(again);
    resumed.assign(bytes.begin(), bytes.end());
    const auto rest_of_points = std::span(sent).subspan(kScanHeaderBytes + again.first * kScanPointBytes);
    resumed.insert(resumed.end(), rest_of_points.begin(), rest_of_points.end());
    left = resumed;
  }
  while (!refused && !decoder.complete()) {
    const std::size_t taken = feed_some(decoder, left, left.size(), refused);
    if (taken == 0) break;
    left = left.subspan(taken);
  }
  if (decoder.complete()) check_complete(decoder, xyz);
  if (own_header) return 0;

  // CRC-32C detects every change within 32 bits, so a changed scan must be rejected, unless the sender repeated the
  // changed header after a cut.
  const bool in_points = changed_at >= kScanHeaderBytes;
  if (changed && in_points) fuzz::must(!decoder.complete(), "a changed point is noticed");
  if (!changed && !points.empty()) {
    fuzz::must(decoder.complete(), "a scan that was not damaged arrives, however it was cut");
    std::vector<float> whole(3 * kPointsMax);
    ScanStreamDecoder at_once(whole);
    at_once.expect(kSession, kCmdSeq);
    fuzz::must(at_once.feed(first_header).ok() && at_once.feed(points).ok() && at_once.complete(), "in one piece too");
    fuzz::must(at_once.finite() == decoder.finite(), "whatever the pieces, as many points");
    fuzz::must(std::memcmp(xyz.data(), whole.data(), 3 * at_once.points() * sizeof(float)) == 0,
               "whatever the pieces, the same points");
  }
  return 0;
}
