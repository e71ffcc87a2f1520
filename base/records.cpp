// SPDX-License-Identifier: Apache-2.0
#include "base/records.h"

#include <algorithm>
#include <array>

namespace slabd {

std::string_view name(RegistrationStatus status) {
  switch (status) {
    case RegistrationStatus::none: return "none";
    case RegistrationStatus::converged: return "converged";
    case RegistrationStatus::iteration_limit: return "iteration_limit";
    case RegistrationStatus::degenerate: return "degenerate";
    case RegistrationStatus::rejected: return "rejected";
  }
  return "none";
}

std::string_view name(PlaneDoubt doubt) {
  switch (doubt) {
    case PlaneDoubt::none: return "none";
    case PlaneDoubt::not_fitted: return "not_fitted";
    case PlaneDoubt::no_plane: return "no_plane";
    case PlaneDoubt::unsettled: return "unsettled";
    case PlaneDoubt::second_surface: return "second_surface";
    case PlaneDoubt::share: return "share";
    case PlaneDoubt::area: return "area";
    case PlaneDoubt::support: return "support";
    case PlaneDoubt::bends: return "bends";
    case PlaneDoubt::rival: return "rival";
    case PlaneDoubt::filled: return "filled";
  }
  return "none";
}

std::string_view reason_of(PlaneDoubt doubt) {
  switch (doubt) {
    case PlaneDoubt::none:
    case PlaneDoubt::not_fitted: break;
    case PlaneDoubt::no_plane: return "its points make no plane";
    case PlaneDoubt::unsettled: return "the fit did not converge";
    case PlaneDoubt::second_surface: return "a second surface is within the threshold";
    case PlaneDoubt::share: return "too small a share of the points fits";
    case PlaneDoubt::area: return "too small a share of the area seen: another surface is where fewer points return";
    case PlaneDoubt::support: return "it is based on too few points, too little of the face, or too noisy ones";
    case PlaneDoubt::bends: return "the fit depends on the exact threshold, as next to a second surface";
    case PlaneDoubt::rival: return "another plane holds about as many points";
    case PlaneDoubt::filled: return "a part of it was computed by the scanner's program and not seen";
  }
  return "";
}

std::string_view name(CasingDoubt doubt) {
  switch (doubt) {
    case CasingDoubt::none: return "none";
    case CasingDoubt::not_measured: return "not_measured";
    case CasingDoubt::edge: return "edge";
    case CasingDoubt::radius: return "radius";
    case CasingDoubt::no_hole: return "no_hole";
    case CasingDoubt::rim_points: return "rim_points";
    case CasingDoubt::rim_crust: return "rim_crust";
    case CasingDoubt::rim_form: return "rim_form";
    case CasingDoubt::filled: return "filled";
  }
  return "none";
}

std::string_view reason_of(CasingDoubt doubt) {
  switch (doubt) {
    case CasingDoubt::none:
    case CasingDoubt::not_measured: break;
    case CasingDoubt::edge: return "too little of the bore's edge is seen, or it is not a circle";
    case CasingDoubt::radius: return "the bore's radius is off by more than a millimetre";
    case CasingDoubt::no_hole: return "something fills the bore at the height of the rim";
    case CasingDoubt::rim_points: return "too few points on the rim";
    case CasingDoubt::rim_crust: return "something on the rim is higher than the seat";
    case CasingDoubt::rim_form: return "the rim is not an even plane all the way round";
    case CasingDoubt::filled: return "a part of it was computed by the scanner's program and not seen";
  }
  return "";
}

std::string_view name(FindingKind kind) {
  switch (kind) {
    case FindingKind::pit: return "pit";
    case FindingKind::bump: return "bump";
    case FindingKind::crack: return "crack";
    case FindingKind::chip: return "chip";
    case FindingKind::missing: return "missing";
  }
  return "pit";
}

std::string_view name(FindingFace face) {
  switch (face) {
    case FindingFace::seat: return "seat";
    case FindingFace::jaw_inner: return "jaw_inner";
    case FindingFace::jaw_outer: return "jaw_outer";
    case FindingFace::shoulder_inner: return "shoulder_inner";
    case FindingFace::shoulder_outer: return "shoulder_outer";
  }
  return "seat";
}

std::string_view name(EdgeFace face) {
  switch (face) {
    case EdgeFace::seat: return "seat";
    case EdgeFace::jaw_inner: return "jaw_inner";
    case EdgeFace::jaw_outer: return "jaw_outer";
    case EdgeFace::shoulder_inner: return "shoulder_inner";
    case EdgeFace::shoulder_outer: return "shoulder_outer";
    case EdgeFace::end_minus: return "end_minus";
    case EdgeFace::end_plus: return "end_plus";
    case EdgeFace::side_inner: return "side_inner";
    case EdgeFace::side_outer: return "side_outer";
  }
  return "seat";
}

bool is_too_deep(const PoreSummary& pores) {
  return pores.deepest_mm > pores.limits.depth_max_mm;
}
bool is_too_much(const PoreSummary& pores) {
  return pores.share > pores.limits.share_max;
}
Verdict with_pore_limits(Verdict by_diameter, const PoreSummary& pores) {
  if (by_diameter == Verdict::not_measured) return by_diameter;
  return is_too_deep(pores) || is_too_much(pores) ? Verdict::fail : by_diameter;
}

FixedString<160> sentence(const PoreSummary& pores) {
  FixedString<160> text;
  if (!has_value(pores.largest_mm)) return text;
  text.printf("%u pore%s, largest %.1f mm, deepest %.1f mm", pores.count, pores.count == 1 ? "" : "s", pores.largest_mm,
              pores.deepest_mm);
  FixedString<48> part;
  const auto add_limit = [&](bool exceeded, double limit, const char* unit) {
    if (!has_value(limit)) return;
    part.printf(" (%s %g %s)", exceeded ? "more than" : "at most", limit, unit);
    text.append(part.view());
  };
  add_limit(is_too_deep(pores), pores.limits.depth_max_mm, "mm");
  if (!has_value(pores.share)) return text;
  part.printf(", %.2f %% of the area", 100.0 * pores.share);
  text.append(part.view());
  add_limit(is_too_much(pores), 100.0 * pores.limits.share_max, "%");
  return text;
}

FixedString<160> sentence(const SurfaceFinding& f) {
  constexpr std::array<const char*, kFindingFaces> kFaces = {"the seat", "the inner jaw", "the outer jaw",
                                                             "the inner shoulder", "the outer shoulder"};
  FixedString<160> text;
  text.printf("%s on %s at x %.0f mm, s %.0f mm: %.0f x %.0f mm, %.0f mm2", name(f.kind).data(),
              kFaces.at(static_cast<std::size_t>(f.face)), f.x_mm, f.s_mm, f.length_mm, f.width_mm, f.area_mm2);
  if (has_value(f.depth_mm)) {
    FixedString<32> depth;
    depth.printf(", up to %.1f mm %s", f.depth_mm, f.kind == FindingKind::bump ? "high" : "deep");
    text.append(depth.view());
  }
  return text;
}

FixedString<420> scan_warning(const ScanCounts& scan) {
  FixedString<420> text;
  if (scan.step_mm.maxCoeff() > kUsualStep_mm)
    text.printf(
        "the coordinates are rounded to %g, %g, %g mm (x, y, z of the scanner; 0: not rounded), which makes U larger "
        "and may hide filled gaps: let the scanner write more decimals",
        scan.step_mm.x(), scan.step_mm.y(), scan.step_mm.z());
  if (scan.lag_ratio < kSmoothedLagRatio) {
    FixedString<210> smoothed;
    smoothed.printf(
        "%sneighbouring points share their noise (%.1f, without a filter 3): the scan was smoothed, and a wrong point "
        "becomes a bump; switch off the filters of the scanner's program",
        text.empty() ? "" : "; ", scan.lag_ratio);
    text.append(smoothed.view());
  }
  return text;
}

std::uint16_t reason_for(Verdict verdict, const Item* begin, const Item* end, Code code) {
  if (verdict == Verdict::pass) return 0;
  if (verdict != Verdict::fail && code != Code::ok) return static_cast<std::uint16_t>(code);
  int lowest = -1;
  for (const Item* item = begin; item != end; ++item) {
    if (item->verdict != verdict) continue;
    if (verdict == Verdict::not_measured && !item->required) continue;
    const int reason = info(item->id).reason;
    if (reason >= 0 && (lowest < 0 || reason < lowest)) lowest = reason;
  }
  if (lowest >= 0) return static_cast<std::uint16_t>(lowest);
  return static_cast<std::uint16_t>(code == Code::ok ? Code::fit_failed : code);
}

namespace {

bool decide_by_themselves(const BlockResult& block) {
  const Item* damage = find_item(block.items.begin(), block.items.end(), ItemId::block_damage);
  const bool judged = damage != nullptr && has_value(damage->upper) && has_value(damage->value);
  return !block.findings.empty() && !judged;
}

}  // namespace

Verdict with_findings(Verdict by_items, const BlockResult& block) {
  return by_items == Verdict::pass && decide_by_themselves(block) ? Verdict::indeterminate : by_items;
}

std::uint16_t reason_with_findings(Verdict verdict, const Item* begin, const Item* end, Code code,
                                   const BlockResult& block) {
  const bool by_item =
      std::any_of(begin, end, [&](const Item& item) { return item.verdict == Verdict::indeterminate; });
  if (verdict == Verdict::indeterminate && code == Code::ok && !by_item && decide_by_themselves(block))
    return static_cast<std::uint16_t>(info(ItemId::block_damage).reason);
  return reason_for(verdict, begin, end, code);
}

std::uint16_t fail_mask(const Item* begin, const Item* end) {
  std::uint16_t mask = 0;
  for (const Item* item = begin; item != end; ++item) {
    const int bit = info(item->id).plc_bit;
    if (item->verdict == Verdict::fail && bit >= 0) mask = static_cast<std::uint16_t>(mask | (1U << bit));
  }
  return mask;
}

std::uint16_t open_mask(const Item* begin, const Item* end) {
  std::uint16_t mask = 0;
  for (const Item* item = begin; item != end; ++item) {
    const int bit = info(item->id).plc_bit;
    const bool open = item->verdict == Verdict::indeterminate || item->verdict == Verdict::not_measured;
    if (open && bit >= 0) mask = static_cast<std::uint16_t>(mask | (1U << bit));
  }
  return mask;
}

const Item* find_item(const Item* begin, const Item* end, ItemId id, int station) {
  const Item* found = std::find_if(
      begin, end, [&](const Item& item) { return item.id == id && (station < 0 || item.station == station); });
  return found == end ? nullptr : found;
}

}  // namespace slabd
