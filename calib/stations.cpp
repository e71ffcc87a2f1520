// SPDX-License-Identifier: Apache-2.0
//
// A correction absorbs any error at its station, including one of the certificate: a seat certified 10 mm from its
// place gives no residual. Therefore everything detectable is checked before a correction is issued. The robot returned
// to the same pose, the visits agree, and no round is displaced as a whole. The measured points have the certified
// shape, and the correction is not larger than a robot's error.
//
// The place of the mastered slab is unknown. One rigid fit of all stations estimates it, and the corrections refer to
// that. A common motion of all stations changes no item of a slab, because a slab is judged in its own frame.
#include "calib/stations.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdio>

#include "calib/mathematics.h"

namespace slabd::calib {
namespace {

constexpr std::array<std::string_view, 13> kRefusals = {
    "too_few_visits", "unknown_station", "wrong_points", "outside_gate", "slab_moved", "spread",       "shape",
    "shift",          "placement",       "copies",       "turn",         "slope",      "scanner_moved"};
constexpr std::size_t kPlacementStationsMin = 3;
/// Smallest plausible scatter, below the effect of a scan's noise on a seat.
constexpr double kScatterMin_mm = 1e-5;
constexpr double kScatterMin_rad = 1e-8;
/// Two calibrations of one mount rarely differ by more than this factor times their combined uncertainty. It is the
/// 99.9 % quantile of the length of a normal vector, in standard deviations per axis.
constexpr double kMountSigmas = 4.03;
/// Smallest first and second extent of the stations; stations on a line leave the slab's rotation about it
/// undetermined.
constexpr double kPlacementWidthMin_mm = 300.0;

/// Mean of close rotations: averaging their vectors about the first, twice, has an error far below a microradian.
Pose mean_pose(const std::vector<const StationVisit*>& visits) {
  Pose mean = visits.front()->T_base_flange;
  for (int pass = 0; pass < 2; ++pass) {
    Vec3 shift = Vec3::Zero();
    Vec3 turn = Vec3::Zero();
    for (const StationVisit* visit : visits) {
      shift += visit->T_base_flange.translation_mm - mean.translation_mm;
      turn += log_rotation((visit->T_base_flange.rotation * mean.rotation.conjugate()).normalized());
    }
    const double n = static_cast<double>(visits.size());
    const Vec3 by = turn / n;
    mean.translation_mm += shift / n;
    if (by.norm() > 0.0)
      mean.rotation =
          (Quat(Eigen::AngleAxisd(by.norm(), Eigen::Vector3d(by.normalized()))) * mean.rotation).normalized();
  }
  return mean;
}

/// Largest distance of a place from the line through the first one and another.
double width_of(std::span<const Vec3> places) {
  double widest = 0.0;
  for (std::size_t i = 1; i < places.size(); ++i)
    for (std::size_t j = i + 1; j < places.size(); ++j) {
      const Vec3 a = places[i] - places[0];
      const Vec3 b = places[j] - places[0];
      widest = std::max(widest, a.cross(b).norm() / std::max({a.norm(), b.norm(), 1.0}));
    }
  return widest;
}

/// State of one station during the solution.
struct Work {
  const MasterStation* certified = nullptr;
  std::vector<const StationVisit*> visits;
  std::vector<std::vector<Vec3>> points;  ///< [visit][point], base frame by the hand-eye calibration only
  std::vector<Vec3> mean_points;
  std::vector<Vec3> off_mm;   ///< [visit]: offset of the reference point from the mean
  std::vector<Vec3> off_rad;  ///< [visit]: rotation from the mean
  double mount_mm = 0.0;      ///< difference of the visits' hand-eye calibrations from this one, at the seat
  double mount_rad = 0.0;
};

/// Reference point of a seat, or the centroid of balls.
Vec3 reference_point(const MasterStation& certified, const std::vector<Vec3>& points) {
  if (certified.is_seat) return points.front();
  Vec3 sum = Vec3::Zero();
  for (const Vec3& p : points) sum += p;
  return sum / static_cast<double>(points.size());
}

/// Effect of the certificate's standard deviation of a coordinate (mm) on the rotation of its station: standard
/// deviation per axis (rad), rms over the axes. A seat's directions are made perpendicular, and each rotates with its
/// tip. Balls have independent errors, and the fit through them rotates by N^-1 sum d x e with N = sum |d|^2 I - d d'.
/// Balls close to a line determine the rotation about it poorly, at any length of the line.
double turn_rad_per_mm(const MasterStation& certified) {
  if (certified.is_seat) return 1.0 / kSeatLever_mm;
  const Vec3 centre = reference_point(certified, certified.points_mm);
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();
  for (const Vec3& p : certified.points_mm) {
    const Eigen::Vector3d d = p - centre;
    inertia += d.squaredNorm() * Eigen::Matrix3d::Identity() - d * d.transpose();
  }
  return std::sqrt(inertia.inverse().trace() / 3.0);
}

double sum_of_squares(const std::vector<Vec3>& list) {
  double sum = 0.0;
  for (const Vec3& v : list) sum += v.squaredNorm();
  return sum;
}

class Solver {
 public:
  Solver(const MasterCertificate& certificate, const HandEyeNumbers& hand_eye, const StationSettings& settings)
      : certificate_(certificate), hand_eye_(hand_eye), X_(hand_eye.T_flange_scanner), settings_(settings) {}

  StationsSolution run(std::span<const StationVisit> visits) {
    sort_visits(visits);
    if (!out_.reasons.empty()) return out_;
    for (Work& work : work_) splice(work);
    check_gate();
    check_mount();
    if (!place_certificate()) return out_;
    find_scatter();
    for (Work& work : work_) correct(work);
    check_rounds();
    for (std::size_t i = 0; i < work_.size(); ++i) check(work_[i], out_.stations[i]);
    check_slopes();
    judge();
    return out_;
  }

 private:
  [[gnu::format(printf, 5, 6)]] void refuse(StationRefusal code, int station, const char* cure, const char* format,
                                            ...) {
    std::array<char, 320> text{};
    va_list args;
    va_start(args, format);
    std::vsnprintf(text.data(), text.size(), format, args);
    va_end(args);
    out_.reasons.push_back({code, station, text.data(), cure});
  }

  void sort_visits(std::span<const StationVisit> visits) {
    for (const MasterStation& s : certificate_.stations) {
      Work& work = work_.emplace_back();
      work.certified = &s;
      for (const StationVisit& visit : visits) {
        if (visit.station != s.station) continue;
        if (visit.points_mm.size() != s.points_mm.size()) {
          refuse(StationRefusal::wrong_points, s.station, "give the visits the points of the certificate, in its order",
                 "station %d, %s: %zu points were seen, %zu are certified", s.station, visit.round.c_str(),
                 visit.points_mm.size(), s.points_mm.size());
          continue;
        }
        if (!is_new(work, visit)) continue;
        work.visits.push_back(&visit);
      }
      if (work.visits.size() < settings_.visits_min)
        refuse(StationRefusal::too_few_visits, s.station,
               "let the robot measure another round, or leave the station out of the certificate: it is then not "
               "corrected",
               "station %d has %zu visits, it needs %zu", s.station, work.visits.size(), settings_.visits_min);
    }
    for (const StationVisit& visit : visits) {
      const bool known = std::any_of(certificate_.stations.begin(), certificate_.stations.end(),
                                     [&](const MasterStation& s) { return s.station == visit.station; });
      if (!known && std::find(unknown_.begin(), unknown_.end(), visit.station) == unknown_.end())
        unknown_.push_back(visit.station);
    }
    for (const int station : unknown_)
      refuse(StationRefusal::unknown_station, station, "leave out its visits, or use the certificate that has it",
             "station %d was visited, but certificate %s does not have it", station, certificate_.id.c_str());
  }

  /// False if the visit was already given, under any name; a repeated visit would make the repeatability too good.
  bool is_new(const Work& work, const StationVisit& visit) {
    for (const StationVisit* known : work.visits) {
      const bool same_round = known->round == visit.round;
      const bool same_numbers =
          known->points_mm == visit.points_mm && known->T_base_flange.to_array() == visit.T_base_flange.to_array();
      if (!same_round && !same_numbers) continue;
      const auto said = [](const StationReason& reason) { return reason.code == StationRefusal::copies; };
      if (std::any_of(out_.reasons.begin(), out_.reasons.end(), said)) return false;
      constexpr const char* kCure = "give every round once, with its own name; the names identify repeated rounds";
      if (same_round)
        refuse(StationRefusal::copies, 0, kCure, "station %d has two visits of one round, %s", visit.station,
               visit.round.c_str());
      else
        refuse(StationRefusal::copies, 0, kCure, "station %d: %s and %s are one visit", visit.station,
               known->round.c_str(), visit.round.c_str());
      return false;
    }
    return true;
  }

  void splice(Work& work) {
    const std::size_t count = work.certified->points_mm.size();
    work.mean_points.assign(count, Vec3::Zero());
    for (const StationVisit* visit : work.visits) {
      const Pose T_base_scanner = visit->T_base_flange * X_;
      std::vector<Vec3>& points = work.points.emplace_back();
      for (const Vec3& q : visit->points_mm) points.push_back(T_base_scanner * q);
      for (std::size_t i = 0; i < count; ++i)
        work.mean_points[i] += points[i] / static_cast<double>(work.visits.size());
    }
  }

  void check_gate() {
    for (const Work& work : work_) {
      const Pose mean = mean_pose(work.visits);
      for (const StationVisit* visit : work.visits) {
        const double off_mm = (visit->T_base_flange.translation_mm - mean.translation_mm).norm();
        const double off_rad = angle_between_rad(mean.rotation, visit->T_base_flange.rotation);
        if (off_mm <= settings_.gate_mm && off_rad <= settings_.gate_rad) continue;
        refuse(
            StationRefusal::outside_gate, visit->station,
            "run the taught program unchanged on every round, and leave out the visit that differs",
            "station %d, %s: the robot reported a pose %.3f mm and %.4f deg from the mean of the visits, allowed are "
            "%.3f mm and %.4f deg",
            visit->station, visit->round.c_str(), off_mm, deg_from_rad(off_rad), settings_.gate_mm,
            deg_from_rad(settings_.gate_rad));
      }
    }
  }

  /// Checks that the scanner's mount is the same as at the visits.
  void check_mount() {
    const Work* worst = nullptr;
    const StationVisit* taken = nullptr;
    double limit_mm = 0.0;
    double limit_rad = 0.0;
    double worst_share = 1.0;
    for (Work& work : work_) {
      for (const StationVisit* visit : work.visits) {
        if (!visit->hand_eye) continue;
        const HandEyeNumbers& then = *visit->hand_eye;
        const Vec3 seen = reference_point(*work.certified, visit->points_mm);
        const double off_mm = (X_ * seen - then.T_flange_scanner * seen).norm();
        const double off_rad = angle_between_rad(X_.rotation, then.T_flange_scanner.rotation);
        work.mount_mm = std::max(work.mount_mm, off_mm);
        work.mount_rad = std::max(work.mount_rad, off_rad);
        const double most_mm = kMountSigmas * both(hand_eye_.sigma_mm, then.sigma_mm) + kScatterMin_mm;
        const double most_rad = kMountSigmas * both(hand_eye_.sigma_rad, then.sigma_rad) + kScatterMin_rad;
        const double share = std::max(off_mm / most_mm, off_rad / most_rad);
        if (share <= worst_share) continue;
        worst_share = share;
        worst = &work;
        taken = visit;
        limit_mm = most_mm;
        limit_rad = most_rad;
      }
      out_.mount_mm = std::max(out_.mount_mm, work.mount_mm);
      out_.mount_rad = std::max(out_.mount_rad, work.mount_rad);
    }
    if (worst == nullptr) return;
    refuse(StationRefusal::scanner_moved, 0,
           "these visits were measured with the scanner in another place: put the mastered slab into the cell again "
           "and have the line inspect it five times with the hand-eye calibration in force",
           "station %d, %s: its hand-eye calibration%s%s and the one in force put the seat %.3f mm and %.4f deg apart, "
           "more than both are uncertain by (%.3f mm, %.4f deg): the scanner has moved on the flange",
           worst->certified->station, taken->round.c_str(), taken->hand_eye_id.empty() ? "" : " ",
           taken->hand_eye_id.c_str(), worst->mount_mm, deg_from_rad(worst->mount_rad), limit_mm,
           deg_from_rad(limit_rad));
  }
  /// Root sum of squares; an unknown value is ignored.
  [[nodiscard]] static double both(double a, double b) {
    return std::hypot(has_value(a) ? a : 0.0, has_value(b) ? b : 0.0);
  }

  /// Places the certificate by one rigid fit of all certified points to all measured ones.
  bool place_certificate() {
    if (certificate_.frame == MasterCertificate::Frame::base) return true;
    if (settings_.T_base_certificate) {
      out_.T_base_certificate = *settings_.T_base_certificate;
      return true;
    }
    std::vector<Vec3> certified;
    std::vector<Vec3> seen;
    std::vector<Vec3> places;
    for (const Work& work : work_) {
      certified.insert(certified.end(), work.certified->points_mm.begin(), work.certified->points_mm.end());
      seen.insert(seen.end(), work.mean_points.begin(), work.mean_points.end());
      places.push_back(reference_point(*work.certified, work.certified->points_mm));
    }
    const double widest = width_of(places);
    if (places.size() < kPlacementStationsMin || widest < kPlacementWidthMin_mm) {
      refuse(StationRefusal::placement, 0,
             "master stations of both rows, or use a certificate in the base frame (frame = base)",
             "the position of the mastered slab cannot be found from %zu stations that spread %.0f mm across; it takes "
             "%zu that spread %.0f mm",
             places.size(), widest, kPlacementStationsMin, kPlacementWidthMin_mm);
      return false;
    }
    out_.T_base_certificate = rigid_fit(certified, seen);
    return true;
  }

  void find_scatter() {
    double mm2 = 0.0;
    double rad2 = 0.0;
    int degrees = 0;
    for (Work& work : work_) {
      const Vec3 centre = reference_point(*work.certified, work.mean_points);
      for (const std::vector<Vec3>& points : work.points) {
        work.off_mm.push_back(reference_point(*work.certified, points) - centre);
        work.off_rad.push_back(log_rotation(rigid_fit(work.mean_points, points).rotation));
      }
      mm2 += sum_of_squares(work.off_mm);
      rad2 += sum_of_squares(work.off_rad);
      degrees += 3 * (static_cast<int>(work.visits.size()) - 1);
    }
    out_.degrees_of_freedom = degrees;
    out_.pooled_sigma_mm = std::sqrt(mm2 / degrees);
    out_.pooled_sigma_rad = std::sqrt(rad2 / degrees);
    if (!(out_.pooled_sigma_mm > kScatterMin_mm) || !(out_.pooled_sigma_rad > kScatterMin_rad))
      refuse(StationRefusal::copies, 0, "give five different rounds; what repeats is then known from them",
             "the visits agree to %.1e mm and %.1e rad: no robot does, they are one visit given several times",
             out_.pooled_sigma_mm, out_.pooled_sigma_rad);
  }

  void correct(const Work& work) {
    StationSolution& s = out_.stations.emplace_back();
    s.station = work.certified->station;
    std::vector<Vec3> from;
    std::vector<Vec3> to;
    for (const std::vector<Vec3>& points : work.points)
      for (std::size_t i = 0; i < points.size(); ++i) {
        from.push_back(points[i]);
        to.push_back(out_.T_base_certificate * work.certified->points_mm[i]);
      }
    StationCorrection& c = s.numbers;
    c.T_base_reported = rigid_fit(from, to);
    // The mean measured reference point must coincide with the certified one, whatever the directions; their points
    // only rotate.
    const Vec3 seen = reference_point(*work.certified, work.mean_points);
    const Vec3 certified = out_.T_base_certificate * reference_point(*work.certified, work.certified->points_mm);
    c.T_base_reported.translation_mm = certified - c.T_base_reported.rotation * seen;
    c.T_base_flange = mean_pose(work.visits);
    c.visits = static_cast<std::uint8_t>(std::min<std::size_t>(work.visits.size(), 255));
    s.shift_mm = certified - seen;
    s.turn_rad = angle_between_rad(c.T_base_reported.rotation, Quat::Identity());

    const double degrees = 3.0 * (static_cast<double>(work.visits.size()) - 1.0);
    c.spread_mm = std::sqrt(sum_of_squares(work.off_mm) / degrees);
    s.spread_rad = std::sqrt(sum_of_squares(work.off_rad) / degrees);
    // The certificate's error is contained once in every use of the correction. It is included in the sigma of one
    // visit. One visit and the mean of M visits then contain it once: sigma^2 (1 + 1 / M).
    const double share = 1.0 / (1.0 + 1.0 / static_cast<double>(work.visits.size()));
    // The same applies to a possible move of the scanner.
    const double once_mm = std::hypot(certificate_.sigma_mm, work.mount_mm / std::sqrt(3.0));
    const double once_rad =
        std::hypot(certificate_.sigma_mm * turn_rad_per_mm(*work.certified), work.mount_rad / std::sqrt(3.0));
    c.sigma_mm = std::hypot(settle(c.spread_mm, degrees, out_.pooled_sigma_mm), std::sqrt(share) * once_mm);
    c.sigma_rad = std::hypot(settle(s.spread_rad, degrees, out_.pooled_sigma_rad), std::sqrt(share) * once_rad);

    double shape2 = 0.0;
    for (std::size_t i = 0; i < work.mean_points.size(); ++i)
      shape2 += (c.T_base_reported * work.mean_points[i] - out_.T_base_certificate * work.certified->points_mm[i])
                    .squaredNorm();
    s.shape_mm = std::sqrt(shape2 / static_cast<double>(work.mean_points.size()));
    for (std::size_t v = 0; v < work.visits.size(); ++v) {
      const double off = work.off_mm[v].norm();
      if (v != 0 && off <= s.worst_mm) continue;
      s.worst_mm = off;
      s.worst_round = work.visits[v]->round;
    }
  }

  /// Standard deviation of one visit: the pooled value, unless this station scatters more than chance permits (95 %).
  /// It is enlarged for the limited number of visits (variance of a t-distribution).
  [[nodiscard]] double settle(double own, double own_degrees, double pooled) const {
    // Wilson and Hilferty's approximation of the 95 % quantile of chi-square over its degrees of freedom.
    const double k = 2.0 / (9.0 * own_degrees);
    const double quantile = std::pow(1.0 - k + 1.645 * std::sqrt(k), 3.0);
    const bool louder = own * own > quantile * pooled * pooled;
    const double degrees = louder ? own_degrees : static_cast<double>(out_.degrees_of_freedom);
    const double widened = degrees > 2.0 ? std::sqrt(degrees / (degrees - 2.0)) : 2.0;
    return widened * (louder ? own : pooled);
  }

  /// Checks for a slab that was moved between two rounds, which moves all its stations alike. Without this check every
  /// station would be rejected for its spread, and the cause would be unknown.
  void check_rounds() {
    std::vector<std::string> rounds;
    for (const Work& work : work_)
      for (const StationVisit* visit : work.visits)
        if (std::find(rounds.begin(), rounds.end(), visit->round) == rounds.end()) rounds.push_back(visit->round);
    const auto of_round = [&](const std::string& round, const auto& use) {
      for (const Work& work : work_)
        for (std::size_t v = 0; v < work.visits.size(); ++v)
          if (work.visits[v]->round == round) use(work.off_mm[v]);
    };
    std::vector<Vec3> together;
    for (const std::string& round : rounds) {
      Vec3 sum = Vec3::Zero();
      int count = 0;
      of_round(round, [&](const Vec3& off) {
        sum += off;
        ++count;
      });
      together.push_back(sum / count);
    }
    // Relative to the place in most rounds, because the mean of all would make the good ones appear moved.
    Vec3 usual;
    for (int axis = 0; axis < 3; ++axis) {
      std::vector<double> values;
      values.reserve(together.size());
      for (const Vec3& v : together) values.push_back(v[axis]);
      std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
      usual[axis] = values[values.size() / 2];
    }
    for (std::size_t r = 0; r < rounds.size(); ++r) {
      const double moved_mm = (together[r] - usual).norm();
      double squares = 0.0;
      int count = 0;
      of_round(rounds[r], [&](const Vec3& off) {
        squares += (off - usual).squaredNorm();
        ++count;
      });
      const bool common = moved_mm * moved_mm > 0.5 * squares / count;
      if (count < 3 || moved_mm <= settings_.spread_max_mm || !common) continue;
      moved_ = true;
      refuse(StationRefusal::slab_moved, 0,
             "the mastered slab must not move between the first round and the last: leave this round out and measure "
             "another one",
             "%s: all its stations are off by %.3f mm in the same direction, allowed are %.3f mm", rounds[r].c_str(),
             moved_mm, settings_.spread_max_mm);
    }
  }

  void check(const Work& work, const StationSolution& s) {
    if (!(s.numbers.spread_mm <= settings_.spread_max_mm) && !moved_)
      refuse(StationRefusal::spread, s.station,
             "repeat the visit that differs from the others; if none does, the robot does not repeat well enough here: "
             "same payload, approach and speed every time, warmed up, nothing loose",
             "station %d: its %zu visits scatter by %.3f mm per axis, allowed are %.3f mm; furthest from the others is "
             "%s with %.3f mm",
             s.station, work.visits.size(), s.numbers.spread_mm, settings_.spread_max_mm, s.worst_round.c_str(),
             s.worst_mm);
    if (!(s.shape_mm <= settings_.shape_max_mm))
      refuse(StationRefusal::shape, s.station,
             "compare the certificate with the artefact: order and numbers of its points, its directions",
             "station %d: certified and measured points differ by %.3f mm after the correction, allowed are %.3f mm",
             s.station, s.shape_mm, settings_.shape_max_mm);
    if (!(s.shift_mm.norm() <= settings_.shift_max_mm))
      refuse(StationRefusal::shift, s.station,
             "is the certificate of this slab, this way round, with these station numbers? Is the right hand-eye "
             "calibration in force?",
             "station %d: the correction would move the seat by %.3f mm, more than the %.3f mm that a robot may be off",
             s.station, s.shift_mm.norm(), settings_.shift_max_mm);
    if (!(s.turn_rad <= settings_.turn_max_rad))
      refuse(
          StationRefusal::turn, s.station,
          "look at this station's normal and direction in the certificate (from the inner to the outer casing), and "
          "whether the slab has the orientation that the certificate assumes",
          "station %d: the correction would turn the seat by %.4f deg, more than the %.4f deg that a robot may be off",
          s.station, deg_from_rad(s.turn_rad), deg_from_rad(settings_.turn_max_rad));
  }

  /// Checks the certified slopes. A correction absorbs a wrong certified direction, and the seat would then read as
  /// certified. The block itself is an independent reference: its seat against the slab's top next to it. The
  /// difference is due to warp and tilt of the slab and is similar at all stations. An outlier is a mistake in the
  /// certificate or a bad block.
  void check_slopes() {
    std::vector<std::pair<double, int>> off;
    for (const Work& work : work_) {
      if (!work.certified->is_seat || certificate_.frame != MasterCertificate::Frame::slab) continue;
      double local = 0.0;
      for (const StationVisit* visit : work.visits)
        local += visit->local_slope_rad / static_cast<double>(work.visits.size());
      const Vec3 n = work.certified->points_mm[1] - work.certified->points_mm[0];
      if (has_value(local)) off.emplace_back(std::abs(std::atan2(n.y(), n.z())) - local, work.certified->station);
    }
    if (off.size() < kPlacementStationsMin) return;
    std::vector<std::pair<double, int>> sorted = off;
    std::sort(sorted.begin(), sorted.end());
    const double usual = sorted[sorted.size() / 2].first;
    for (const auto& [difference, station] : off) {
      if (std::abs(difference - usual) <= settings_.slope_max_rad) continue;
      refuse(
          StationRefusal::slope, station,
          "compare the certificate with the block: is its normal that of this seat? If the slab is right, master with "
          "another one whose top is even next to this seat",
          "station %d: the certified slope differs from the one measured on the block by %.4f deg, at the other "
          "stations by %.4f deg; a difference of %.4f deg is allowed",
          station, deg_from_rad(difference), deg_from_rad(usual), deg_from_rad(settings_.slope_max_rad));
    }
  }

  void judge() {
    double before2 = 0.0;
    double after2 = 0.0;
    double count = 0.0;
    out_.table.slab_type = certificate_.slab_type;
    for (std::size_t i = 0; i < work_.size(); ++i) {
      const Work& work = work_[i];
      const StationSolution& s = out_.stations[i];
      const Vec3 certified = out_.T_base_certificate * reference_point(*work.certified, work.certified->points_mm);
      for (const std::vector<Vec3>& points : work.points) {
        const Vec3 p = reference_point(*work.certified, points);
        before2 += (p - certified).squaredNorm();
        after2 += (s.numbers.T_base_reported * p - certified).squaredNorm();
        count += 1.0;
      }
      out_.table.station[static_cast<std::size_t>(s.station - 1)] = s.numbers;
    }
    out_.before_rms_mm = std::sqrt(before2 / count);
    out_.after_rms_mm = std::sqrt(after2 / count);
    out_.ok = out_.reasons.empty();
    if (!out_.ok) out_.table = {};
  }

  const MasterCertificate& certificate_;
  const HandEyeNumbers& hand_eye_;
  const Pose X_;
  const StationSettings settings_;
  std::vector<Work> work_;
  std::vector<int> unknown_;
  bool moved_ = false;
  StationsSolution out_;
};

}  // namespace

std::string_view name(StationRefusal refusal) {
  return kRefusals.at(static_cast<std::size_t>(refusal));
}

std::optional<Pose> placement_of(const MasterCertificate& certificate, std::span<const StationVisit> visits,
                                 std::span<const Pose> T_base_scanner) {
  if (certificate.frame == MasterCertificate::Frame::base) return std::nullopt;
  std::vector<Vec3> certified;
  std::vector<Vec3> seen;
  std::vector<Vec3> places;
  for (std::size_t i = 0; i < visits.size(); ++i) {
    const auto station = std::find_if(certificate.stations.begin(), certificate.stations.end(),
                                      [&](const MasterStation& s) { return s.station == visits[i].station; });
    if (station == certificate.stations.end() || station->points_mm.size() != visits[i].points_mm.size())
      return std::nullopt;
    certified.insert(certified.end(), station->points_mm.begin(), station->points_mm.end());
    for (const Vec3& point : visits[i].points_mm) seen.push_back(T_base_scanner[i] * point);
    places.push_back(station->points_mm.front());
  }
  if (places.size() < kPlacementStationsMin || width_of(places) < kPlacementWidthMin_mm) return std::nullopt;
  return rigid_fit(certified, seen);
}

Result<StationsSolution> solve_stations(const MasterCertificate& certificate, std::span<const StationVisit> visits,
                                        const HandEyeNumbers& hand_eye, const StationSettings& settings) {
  if (visits.empty()) return error(Code::config, "no visits to solve station corrections from");
  if (!hand_eye.T_flange_scanner.all_finite()) return error(Code::config, "T_flange_scanner is not finite");
  for (const StationVisit& visit : visits) {
    const bool finite = visit.T_base_flange.all_finite() && std::all_of(visit.points_mm.begin(), visit.points_mm.end(),
                                                                        [](const Vec3& p) { return p.allFinite(); });
    if (!finite)
      return error(Code::config, "station %d, %s: a number is not finite", visit.station, visit.round.c_str());
  }
  StationSettings used = settings;
  used.visits_min = std::max<std::size_t>(used.visits_min, 2);  // one visit does not determine its own scatter
  return Solver(certificate, hand_eye, used).run(visits);
}

}  // namespace slabd::calib
