// SPDX-License-Identifier: Apache-2.0
//
// Comparison of a repeated measurement with the stored one. It uses the column lists of storage/rows.h, because
// hand-written comparisons would miss new columns.
//
// Invariant: two numbers are equal exactly if the database would store the same bits for them. NaN is NULL and minus
// zero is zero; all other numbers are compared to the last bit (the shortest text that reads back as the number).
#include "storage/compare.h"

#include <algorithm>
#include <charconv>

#include "storage/rows.h"

namespace slabd::storage {
namespace {

std::string text_of(double value) {
  if (!has_value(value)) return "none";
  std::array<char, 40> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value == 0.0 ? 0.0 : value);
  return {text.data(), end.ptr};
}

/// The values of a row as text, in the order of its column names.
class Texts {
 public:
  template <typename T>
  void operator()(std::string_view, const T& value) {
    put(value);
  }
  [[nodiscard]] const std::vector<std::string>& list() const { return list_; }

 private:
  void put(double value) { list_.push_back(text_of(value)); }
  void put(const Vec3& v) {
    for (const double x : {v.x(), v.y(), v.z()}) put(x);
  }
  void put(const Pose& pose) {
    for (const double x : pose.to_array()) put(x);
  }
  template <std::size_t N>
  void put(const std::array<double, N>& values) {
    for (const double x : values) put(x);
  }
  template <int N>
  requires(N > 1) void put(const Square<N>& m) {
    for (int row = 0; row < N; ++row)
      for (int column = 0; column < N; ++column) put(m(row, column));
  }
  template <std::size_t N>
  void put(const FixedString<N>& text) {
    list_.emplace_back(text.view());
  }
  template <std::integral T>
  void put(T value) {
    list_.push_back(std::to_string(value));
  }
  template <typename E>
  requires std::is_enum_v<E>
  void put(E value) { list_.emplace_back(word(value)); }

  std::vector<std::string> list_;
};

/// True for durations: they are not results.
bool is_time(std::string_view column) {
  constexpr std::array<std::string_view, 5> kTimes = {"read_ms", "denoise_ms", "register_ms", "extract_ms", "total_ms"};
  return std::find(kTimes.begin(), kTimes.end(), column) != kTimes.end();
}

template <typename Row>
void compare_row(const std::string& place, const Row& stored, const Row& now, Comparison& out) {
  Texts was;
  Texts is;
  columns(was, stored);
  columns(is, now);
  const std::vector<std::string> names = names_of<Row>();
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (is_time(names[i])) continue;
    ++out.figures;
    if (was.list()[i] != is.list()[i])
      out.differences.push_back({(place.empty() ? "" : place + " ") + names[i], was.list()[i], is.list()[i]});
  }
}

std::string place_of(const Item& item) {
  std::string place = "item " + std::string(info(item.id).name);
  if (item.station != 0) place += " " + std::to_string(item.station);
  if (item.station_to != 0) place += "-" + std::to_string(item.station_to);
  return place;
}

template <std::size_t N>
void compare_items(const FixedVector<Item, N>& stored, const FixedVector<Item, N>& now, Comparison& out) {
  if (stored.size() != now.size())
    out.differences.push_back({"items", std::to_string(stored.size()), std::to_string(now.size())});
  for (std::size_t i = 0; i < std::min(stored.size(), now.size()); ++i)
    compare_row(place_of(stored[i]), stored[i], now[i], out);
}

}  // namespace

void compare(const BlockResult& stored, const BlockResult& now, Comparison& out) {
  compare_row("", stored, now, out);
  compare_row("plane seat", stored.seat.plane, now.seat.plane, out);
  compare_row("plane seat_full", stored.seat.full_plane, now.seat.full_plane, out);
  compare_row("plane jaw_inner", stored.jaw_inner, now.jaw_inner, out);
  compare_row("plane jaw_outer", stored.jaw_outer, now.jaw_outer, out);
  compare_row("plane slab_top", stored.slab_top, now.slab_top, out);
  compare_row("casing inner", stored.casing_inner, now.casing_inner, out);
  compare_row("casing outer", stored.casing_outer, now.casing_outer, out);
  if (stored.findings.size() != now.findings.size())
    out.differences.push_back(
        {"findings", std::to_string(stored.findings.size()), std::to_string(now.findings.size())});
  for (std::size_t i = 0; i < std::min(stored.findings.size(), now.findings.size()); ++i)
    compare_row("finding " + std::to_string(i + 1), stored.findings[i], now.findings[i], out);
  if (stored.edges.size() != now.edges.size())
    out.differences.push_back({"edges", std::to_string(stored.edges.size()), std::to_string(now.edges.size())});
  for (std::size_t i = 0; i < std::min(stored.edges.size(), now.edges.size()); ++i)
    compare_row("edge " + std::to_string(i + 1), stored.edges[i], now.edges[i], out);
  compare_items(stored.items, now.items, out);
}

void compare(const BlockMaps& stored, const BlockMaps& now, Comparison& out) {
  const auto one = [&](const char* name, const PackedMap& was, const PackedMap& is) {
    if (was.empty()) return;
    ++out.figures;
    const bool same = was.columns == is.columns && was.rows == is.rows && was.cell_mm == is.cell_mm &&
                      was.step_mm == is.step_mm &&
                      std::equal(was.bytes.begin(), was.bytes.end(), is.bytes.begin(), is.bytes.end());
    const auto words = [](const PackedMap& map) {
      return std::to_string(map.columns) + " x " + std::to_string(map.rows) + " cells in " +
             std::to_string(map.bytes.size()) + " bytes";
    };
    if (!same) out.differences.push_back({name, words(was), words(is)});
  };
  one("map registration", stored.registration, now.registration);
  one("map seat", stored.seat, now.seat);
}

void compare(const SlabResult& stored, const SlabResult& now, Comparison& out) {
  compare_row("", stored, now, out);
  for (std::size_t i = 0; i < stored.station_verdict.size(); ++i)
    compare_row("station " + std::to_string(i + 1),
                StationResult{0, stored.station_verdict[i], stored.station_reason[i]},
                StationResult{0, now.station_verdict[i], now.station_reason[i]}, out);
  compare_items(stored.items, now.items, out);
  // The values of the gauges are the input of both; only what is made of it can differ.
  for (std::size_t i = 0; i < std::min(stored.gauges.size(), now.gauges.size()); ++i)
    compare_row("gauge " + std::string(stored.gauges[i].gauge.view()), stored.gauges[i], now.gauges[i], out);
}

}  // namespace slabd::storage
