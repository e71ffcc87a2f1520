// SPDX-License-Identifier: Apache-2.0
//
// Bit format of a map. Each row has five bits k (the row's Rice parameter; 31: nothing was seen). Unless k is 31, runs
// of missing and seen cells follow alternately until the row is full, starting with the missing ones (length + 1 in
// Elias gamma). Then the residuals of the seen cells follow, with the sign folded in. A residual with quotient q =
// residual >> k is q ones, a zero and k bits; after kEscape ones, 18 plain bits follow.
//
// The prediction is the mean of the previous cell and the cell of the row below, or the one of them that was seen. Most
// bits of a map encode noise, so a better prediction would save little. Encoder and decoder keep the same row of
// rounded heights, so no error accumulates.
//
// The worst map takes 38 bits per cell; with a step so large that all heights round to zero it takes little more than
// one bit.
#include "base/packed_map.h"

#include <algorithm>
#include <bit>
#include <limits>

namespace slabd {
namespace {

constexpr std::int32_t kMissing = std::numeric_limits<std::int32_t>::min();
constexpr std::int32_t kHeightMax = 32'767;
constexpr unsigned kEscape = 20;
constexpr unsigned kEscapeBits = 18;
constexpr std::uint32_t kEmptyRow = 31;

static_assert(limits::kMapColumnsMax * limits::kMapColumnsMax / 8 >= limits::kPackedMapBytes);

std::int32_t predicted(std::int32_t before, std::int32_t below) {
  if (before == kMissing) return below == kMissing ? 0 : below;
  if (below == kMissing) return before;
  return (before + below) / 2;
}

std::uint32_t folded(std::int32_t rest) {
  return rest >= 0 ? 2U * static_cast<std::uint32_t>(rest) : 2U * static_cast<std::uint32_t>(-rest) - 1U;
}
std::int32_t unfolded(std::uint32_t rest) {
  const auto half = static_cast<std::int32_t>((rest + 1U) / 2U);
  return rest % 2U == 0U ? half : -half;
}

class BitReader {
 public:
  explicit BitReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  [[nodiscard]] std::uint32_t take(unsigned bits) {
    std::uint32_t value = 0;
    for (unsigned i = 0; i < bits; ++i) {
      if (at_ / 8 >= bytes_.size()) {
        ok_ = false;
        return 0;
      }
      value = value << 1U | (unsigned{bytes_[at_ / 8]} >> (7U - at_ % 8) & 1U);
      ++at_;
    }
    return value;
  }
  /// Counts ones up to the next zero, at most `most`.
  [[nodiscard]] unsigned ones(unsigned most) {
    unsigned count = 0;
    while (count < most && take(1) == 1U) ++count;
    return count;
  }
  [[nodiscard]] bool ok() const { return ok_; }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  bool ok_ = true;
};

/// Reads the length of a run; returns most + 1 if it is above `most`.
std::uint32_t take_run(BitReader& bits, std::uint32_t most) {
  const unsigned zeros = bits.ones(16);
  const std::uint32_t length = (1U << zeros | bits.take(zeros)) - 1U;
  return std::min(length, most + 1U);
}

std::uint32_t take_rest(BitReader& bits, unsigned k) {
  const unsigned quotient = bits.ones(kEscape);
  if (quotient == kEscape) return bits.take(kEscapeBits);
  return quotient << k | bits.take(k);
}

/// Reads which cells of a row were seen (0) or missing (kMissing).
bool take_row_mask(BitReader& bits, std::span<std::int32_t> row) {
  bool seen = false;
  for (std::size_t at = 0; at < row.size(); seen = !seen) {
    const std::uint32_t length = take_run(bits, static_cast<std::uint32_t>(row.size() - at));
    if (!bits.ok() || length > row.size() - at || (length == 0 && at > 0)) return false;
    std::fill_n(row.begin() + static_cast<std::ptrdiff_t>(at), length, seen ? 0 : kMissing);
    at += length;
  }
  return true;
}

}  // namespace

MapWriter::MapWriter(PackedMap& out, std::size_t columns, std::size_t rows, double cell_mm, double step_mm)
    : out_(out), rows_(rows) {
  out_ = {};
  out_.columns = static_cast<std::uint16_t>(columns);
  out_.rows = static_cast<std::uint16_t>(rows);
  out_.cell_mm = cell_mm;
  out_.step_mm = step_mm;
  below_.fill(kMissing);
}

void MapWriter::put(std::uint32_t value, unsigned bits) {
  for (unsigned i = bits; i-- > 0;) {
    open_bits_ = open_bits_ << 1U | (value >> i & 1U);
    if (++open_ < 8) continue;
    full_ = !out_.bytes.push(static_cast<std::uint8_t>(open_bits_)) || full_;
    open_bits_ = open_ = 0;
  }
}

void MapWriter::put_run(std::uint32_t length) {
  const std::uint32_t value = length + 1;
  const auto width = static_cast<unsigned>(std::bit_width(value)) - 1U;
  for (unsigned i = 0; i < width; ++i) put(1, 1);
  if (width < 16) put(0, 1);
  put(value & ((1U << width) - 1U), width);
}

void MapWriter::put_rest(std::uint32_t rest, unsigned k) {
  if (rest >> k >= kEscape) {
    for (unsigned i = 0; i < kEscape; ++i) put(1, 1);
    put(rest, kEscapeBits);
    return;
  }
  for (unsigned i = 0; i < rest >> k; ++i) put(1, 1);
  put(0, 1);
  put(rest & ((1U << k) - 1U), k);
}

void MapWriter::add_row(std::span<const double> heights_mm) {
  if (full_ || rows_ == 0) return;
  --rows_;
  std::array<std::uint32_t, limits::kMapColumnsMax> rests;
  std::size_t seen = 0;
  std::uint64_t sum = 0;
  std::int32_t before = kMissing;
  for (std::size_t c = 0; c < heights_mm.size(); ++c) {
    std::int32_t height = kMissing;
    if (std::isfinite(heights_mm[c])) {
      const double steps = std::clamp<double>(std::round(heights_mm[c] / out_.step_mm), -kHeightMax, kHeightMax);
      height = static_cast<std::int32_t>(steps);
      rests[seen] = folded(height - predicted(before, below_[c]));
      sum += rests[seen++];
    }
    before = below_[c] = height;
  }
  if (seen == 0) {
    put(kEmptyRow, 5);
    return;
  }
  unsigned k = 0;
  while (k < 16 && (static_cast<std::uint64_t>(seen) << (k + 1)) <= sum) ++k;
  put(k, 5);
  for (std::size_t at = 0, end = 0; at < heights_mm.size(); at = end) {
    const bool is_seen = at > 0 ? below_[at] != kMissing : false;
    while (end < heights_mm.size() && (below_[end] != kMissing) == is_seen) ++end;
    put_run(static_cast<std::uint32_t>(end - at));
    if (at == 0 && end == 0) {  // the row begins with seen cells: write an empty run of missing ones
      while (end < heights_mm.size() && below_[end] != kMissing) ++end;
      put_run(static_cast<std::uint32_t>(end));
    }
  }
  for (std::size_t i = 0; i < seen; ++i) put_rest(rests[i], k);
}

bool MapWriter::complete() {
  if (open_ > 0) put(0, 8 - open_);
  return !full_ && rows_ == 0;
}

std::optional<std::vector<float>> unpack_map(const PackedMap& map) {
  if (map.columns == 0 || map.columns > limits::kMapColumnsMax || map.rows == 0 || map.rows > limits::kMapColumnsMax ||
      !(map.cell_mm > 0.0) || !(map.step_mm > 0.0))
    return std::nullopt;
  BitReader bits({map.bytes.data(), map.bytes.size()});
  std::vector<float> heights(std::size_t{map.columns} * map.rows, std::numeric_limits<float>::quiet_NaN());
  std::array<std::int32_t, limits::kMapColumnsMax> row;
  row.fill(kMissing);
  for (std::size_t r = 0; r < map.rows; ++r) {
    const std::uint32_t k = bits.take(5);
    std::array<std::int32_t, limits::kMapColumnsMax> below = row;
    if (k == kEmptyRow) {
      row.fill(kMissing);
      continue;
    }
    if (!bits.ok() || k > 16 || !take_row_mask(bits, std::span(row).first(map.columns))) return std::nullopt;
    std::int32_t before = kMissing;
    for (std::size_t c = 0; c < map.columns; ++c) {
      if (row[c] != kMissing) {
        row[c] = predicted(before, below[c]) + unfolded(take_rest(bits, k));
        if (!bits.ok() || std::abs(row[c]) > kHeightMax) return std::nullopt;
        heights[r * map.columns + c] = static_cast<float>(row[c] * map.step_mm);
      }
      before = row[c];
    }
  }
  if (!bits.ok()) return std::nullopt;
  return heights;
}

}  // namespace slabd
