// SPDX-License-Identifier: Apache-2.0
//
// Selection of the most informative view. The predicted error of a scanned point in the field of view depends only on
// the views' normal matrix N, not on measured values. Candidate poses are tilts of 20 to 35 degrees to eight sides,
// rolls, and the target in corners and middle, near, mid and far. Each candidate adds its J'J to N, and the one that
// reduces the predicted error most is suggested. Three rules apply:
//
// - At first N is singular and the scanner's pose is a guess. The guess is a weak prior (30 mm, 10 degrees per axis),
//   which makes the predicted error defined from the first view on. The prior's uncertainty of the target's place also
//   keeps it away from the edge of the picture until the estimate is good enough.
// - The optimum would be a few poses repeated many times, and repeats do not reveal a robot error that varies over the
//   cell. Among candidates within a few per cent of the best, the newest one is taken: a new side, an empty cell of the
//   view, a pose unlike the previous ones.
// - The robot must be able to reach the pose. Candidates are close to a pose already driven and not tilted more than
//   the recipe for views requires. The target is never closer than the near limit of the field of view.
#include "calib/coverage.h"

#include <algorithm>
#include <cmath>

#include "calib/adjustment.h"
#include "calib/mathematics.h"

namespace slabd::calib {
namespace {

constexpr std::array kTilts_deg = {20.0, 27.0, 34.0};
constexpr std::array kRolls_deg = {-90.0, -45.0, 0.0, 45.0, 90.0};
/// As shares of the field of view's half width; the middle is always included.
constexpr std::array kCornerShares = {0.5, 0.92};
constexpr double kDepthMargin = 0.08;  ///< share of the depth range, from its ends

constexpr double kStartShift_mm = 30.0;
const double kStartTurn_rad = rad_from_deg(10.0);
constexpr double kPlaceUnknown_mm = 1000.0;

/// A candidate this close to a pose already driven counts as the same pose.
constexpr double kAgain_mm = 20.0;
const double kAgain_rad = rad_from_deg(3.0);
/// Largest distance of a candidate from some pose already driven.
constexpr double kReach_mm = 600.0;
const double kReach_rad = rad_from_deg(80.0);
/// The target must stay in the view with this many sigmas of its expected place ...
constexpr double kSeenSigmas = 1.5;
/// ... in a view this much wider than the calibrated field of view.
constexpr double kSeenShare = 1.2;
/// Candidates within this factor of the best count as equal; the newest of them is taken.
constexpr double kAsGood = 1.06;

const std::array<std::array<double, 2>, kPlaces> kPlaceSigns = {
    {{0.0, 0.0}, {1.0, 1.0}, {-1.0, 1.0}, {-1.0, -1.0}, {1.0, -1.0}}};

/// Straight down, and the sides as seen from the robot's base.
struct Sides {
  Vec3 down, away, left;

  explicit Sides(const Vec3& down_base) : down(down_base.normalized()) {
    Vec3 x = Vec3::UnitX() - down.x() * down;
    if (x.norm() < 0.1) x = Vec3::UnitY() - down.y() * down;
    away = x.normalized();
    left = (-down).cross(away);
  }
  [[nodiscard]] Vec3 towards(std::size_t sector) const {
    const double angle = 2.0 * kPi * static_cast<double>(sector) / static_cast<double>(kSectors);
    return std::cos(angle) * away + std::sin(angle) * left;
  }
  [[nodiscard]] std::size_t sector_of(const Vec3& axis) const {
    const double angle = std::atan2(axis.dot(left), axis.dot(away));
    const auto sectors = static_cast<int>(kSectors);
    const int sector = static_cast<int>(std::lround(angle / (2.0 * kPi) * sectors));
    return static_cast<std::size_t>((sector + sectors) % sectors);
  }
};

Vec3 axis_of(const Pose& T_base_scanner) {
  return T_base_scanner.rotation * Vec3::UnitZ();
}

std::size_t depth_cell(double z, const FieldOfView& fov) {
  const double third = (fov.far_mm - fov.near_mm) / 3.0;
  return z < fov.near_mm + third ? 0 : z < fov.far_mm - third ? 1 : 2;
}

std::size_t place_cell(const Vec3& c, const FieldOfView& fov) {
  constexpr double kMiddle = 0.4;
  const bool middle_x = std::abs(c.x()) < kMiddle * fov.half_x_mm;
  const bool middle_y = std::abs(c.y()) < kMiddle * fov.half_y_mm;
  if (middle_x && middle_y) return 0;
  for (std::size_t place = 1; place < kPlaces; ++place)
    if (c.x() * kPlaceSigns[place][0] >= 0.0 && c.y() * kPlaceSigns[place][1] >= 0.0) return place;
  return 0;
}

Vec3 target_seen(ArtefactKind kind, const View& view) {
  if (kind == ArtefactKind::pose) return view.T_scanner_target.translation_mm;
  return view.balls.empty() ? Vec3::Zero() : view.balls.front().centre_mm;
}

/// A view with the target at the place given by the state, as used for planned views.
View ideal(ArtefactKind kind, View view, const State& state) {
  const Pose T_scanner_base = (view.T_base_flange * state.X).inverse();
  if (kind == ArtefactKind::pose) view.T_scanner_target = T_scanner_base * state.targets[0];
  for (BallObservation& seen : view.balls) seen.centre_mm = T_scanner_base * state.targets[seen.ball].translation_mm;
  return view;
}

/// Information of the start about the parameters.
Eigen::VectorXd start_information(int parameters) {
  Eigen::VectorXd information = Eigen::VectorXd::Constant(parameters, 1.0 / (kPlaceUnknown_mm * kPlaceUnknown_mm));
  information.head<3>().setConstant(1.0 / (kStartShift_mm * kStartShift_mm));
  information.segment<3>(3).setConstant(1.0 / (kStartTurn_rad * kStartTurn_rad));
  if (parameters == 12) information.tail<3>().setConstant(1e-2);
  return information;
}

Eigen::MatrixXd normal_matrix(const Linearised& linear, int parameters) {
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(parameters, parameters);
  for (const Eigen::MatrixXd& J : linear.J) normal += transposed_product(J, J);
  return normal;
}

/// Most probable state of views and start together: Gauss-Newton from the start.
State lean_on(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise, const Pose& start) {
  constexpr int kIterations = 30;
  State state{start, best_targets(kind, views, start)};
  const Equations equations(kind, views);
  const int parameters = equations.parameters();
  const Eigen::VectorXd trust = start_information(parameters);
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const Linearised linear = linearise(equations, equations.whiteners(state, {noise}), state);
    Eigen::MatrixXd normal = normal_matrix(linear, parameters);
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(parameters);
    for (std::size_t i = 0; i < linear.w.size(); ++i) gradient += transposed_product(linear.J[i], linear.w[i]);
    Eigen::VectorXd off = Eigen::VectorXd::Zero(parameters);
    off.head<3>() = state.X.translation_mm - start.translation_mm;
    off.segment<3>(3) = log_rotation(start.rotation.conjugate() * state.X.rotation);
    normal.diagonal() += trust;
    gradient += trust.cwiseProduct(off);
    const Eigen::VectorXd step = -solve_symmetric(normal, gradient);
    if (!step.allFinite()) break;
    state.X.translation_mm += step.head<3>();
    state.X.rotation = (state.X.rotation * exp_rotation(step.segment<3>(3))).normalized();
    const int width = equations.target_parameters();
    for (std::size_t k = 0; k < state.targets.size(); ++k) {
      const int at = 6 + width * static_cast<int>(k);
      state.targets[k].translation_mm += step.segment<3>(at);
      if (width == 6)
        state.targets[k].rotation = (state.targets[k].rotation * exp_rotation(step.segment<3>(at + 3))).normalized();
    }
    if (step.head<3>().norm() < 1e-6 && step.segment<3>(3).norm() < 1e-9) break;
  }
  return state;
}

/// Search for the next view around one state.
class Search {
 public:
  Search(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise, const CoverageSettings& settings,
         const State& state, const Coverage& coverage)
      : kind_(kind),
        views_(views),
        noise_(noise),
        settings_(settings),
        state_(state),
        coverage_(coverage),
        sides_(settings.down_base) {
    std::vector<View> seen;
    for (const View& view : views) seen.push_back(ideal(kind, view, state));
    const Equations equations(kind, seen);
    parameters_ = equations.parameters();
    information_ = normal_matrix(linearise(equations, equations.whiteners(state, {noise}), state), parameters_);
    information_.diagonal() += start_information(parameters_);
    covariance_ = inverse(information_);
    // The mean square error of a point in the field of view is trace(points_ C).
    points_ = Mat6::Zero();
    const Mat3 R_X = state.X.rotation.toRotationMatrix();
    const FieldOfView& fov = settings.fov;
    for (const double x : {-fov.half_x_mm, 0.0, fov.half_x_mm})
      for (const double y : {-fov.half_y_mm, 0.0, fov.half_y_mm})
        for (const double z : {fov.near_mm, 0.5 * (fov.near_mm + fov.far_mm), fov.far_mm}) {
          Eigen::Matrix<double, 3, 6> J;
          J.leftCols<3>().setIdentity();
          J.rightCols<3>() = -R_X * skew(Vec3(x, y, z));
          points_ += J.transpose() * J / 27.0;
        }
    // The picture's upright direction is that of the first view.
    const Pose first = views[0].T_base_flange * state.X;
    upright_ = rotation_between(axis_of(first), sides_.down) * first.rotation;
  }

  std::optional<Suggestion> best() {
    for (const double tilt : kTilts_deg)
      for (std::size_t sector = 0; sector < kSectors; ++sector)
        for (const double roll : kRolls_deg) offer_places(tilt, sector, roll);
    if (offers_.empty()) return std::nullopt;
    const auto lowest = std::min_element(offers_.begin(), offers_.end(),
                                         [](const Offer& a, const Offer& b) { return a.error < b.error; });
    const Offer* chosen = &*lowest;
    for (const Offer& offer : offers_)
      if (offer.error <= kAsGood * lowest->error && offer.novelty > chosen->novelty) chosen = &offer;
    return chosen->what;
  }

 private:
  struct Offer {
    Suggestion what;
    double error = 0.0;
    double novelty = 0.0;
  };

  void offer_places(double tilt, std::size_t sector, double roll) {
    const Vec3 turn_axis = sides_.down.cross(sides_.towards(sector));
    const Quat rotation = Quat(Eigen::AngleAxisd(rad_from_deg(tilt), Eigen::Vector3d(turn_axis))) * upright_ *
                          Quat(Eigen::AngleAxisd(rad_from_deg(roll), Eigen::Vector3d::UnitZ()));
    const FieldOfView& fov = settings_.fov;
    const double margin = kDepthMargin * (fov.far_mm - fov.near_mm);
    const std::array depths = {fov.near_mm + margin, 0.5 * (fov.near_mm + fov.far_mm), fov.far_mm - margin};
    const double half_x = std::max(0.0, fov.half_x_mm - settings_.target_radius_mm);
    const double half_y = std::max(0.0, fov.half_y_mm - settings_.target_radius_mm);
    for (std::size_t depth = 0; depth < kDepths; ++depth)
      for (std::size_t place = 0; place < kPlaces; ++place)
        for (const double share : kCornerShares) {
          if (place == 0 && share != kCornerShares[0]) continue;
          Suggestion s;
          s.tilt_deg = tilt;
          s.sector = sector;
          s.roll_deg = roll;
          s.place = place;
          s.depth = depth;
          s.target_scanner =
              Vec3(share * half_x * kPlaceSigns[place][0], share * half_y * kPlaceSigns[place][1], depths[depth]);
          const Pose T_base_scanner{rotation, state_.targets[0].translation_mm - rotation * s.target_scanner};
          s.T_base_flange = T_base_scanner * state_.X.inverse();
          offer(s);
        }
  }

  void offer(Suggestion& s) {
    double near_mm = kReach_mm;
    double near_rad = kPi;
    bool reachable = false;
    for (const View& view : views_) {
      const double away_mm = (view.T_base_flange.translation_mm - s.T_base_flange.translation_mm).norm();
      const double away_rad = angle_between_rad(view.T_base_flange.rotation, s.T_base_flange.rotation);
      reachable = reachable || (away_mm <= kReach_mm && away_rad <= kReach_rad);
      near_mm = std::min(near_mm, away_mm);
      near_rad = std::min(near_rad, away_rad);
    }
    if (!reachable || driven_before(s.T_base_flange)) return;
    std::vector<View> one(1, views_[0]);
    one[0].T_base_flange = s.T_base_flange;
    one[0] = ideal(kind_, one[0], state_);
    const Equations equations(kind_, one);
    const Linearised linear = linearise(equations, equations.whiteners(state_, {noise_}), state_);
    if (!in_view(equations, s)) return;
    const Eigen::MatrixXd& J = linear.J[0];
    // C - C J' (I + J C J')^-1 J C: the covariance with one more view.
    const Eigen::MatrixXd JC = product(J, covariance_);
    const Eigen::MatrixXd gain = Eigen::MatrixXd::Identity(J.rows(), J.rows()) + carried(J, covariance_);
    const Eigen::MatrixXd after = covariance_ - transposed_product(JC, solve_symmetric(gain, JC));
    Offer made{s, std::sqrt((points_ * after.topLeftCorner<6, 6>()).trace()), 0.0};
    const std::size_t cell = s.depth * kPlaces + place_cell(s.target_scanner, settings_.fov);
    made.novelty = (coverage_.sectors[s.sector] ? 0.0 : 2.0) + (coverage_.cells[cell] ? 0.0 : 1.5) +
                   std::min(1.0, near_rad / rad_from_deg(40.0)) + std::min(0.5, near_mm / 400.0);
    offers_.push_back(made);
  }

  [[nodiscard]] bool driven_before(const Pose& pose) const {
    const auto again = [&](const Pose& other) {
      return (other.translation_mm - pose.translation_mm).norm() < kAgain_mm &&
             angle_between_rad(other.rotation, pose.rotation) < kAgain_rad;
    };
    return std::any_of(settings_.taken.begin(), settings_.taken.end(), again) ||
           std::any_of(views_.begin(), views_.end(), [&](const View& view) { return again(view.T_base_flange); });
  }

  /// True if the target will be in the view, given the uncertainty of its place.
  bool in_view(const Equations& equations, Suggestion& s) const {
    Eigen::VectorXd r;
    Eigen::MatrixXd J;
    equations.residual(0, state_, r, &J);
    const Eigen::MatrixXd place = carried(J.bottomRows(3), covariance_);
    const Mat3 R_X = state_.X.rotation.toRotationMatrix();
    const Vec3 sigma = Mat3(R_X.transpose() * Mat3(place) * R_X).diagonal().cwiseMax(0.0).cwiseSqrt();
    s.place_sigma_mm = sigma.maxCoeff();
    const FieldOfView& fov = settings_.fov;
    const Vec3 reach = s.target_scanner.cwiseAbs() + kSeenSigmas * sigma;
    return reach.x() <= kSeenShare * fov.half_x_mm && reach.y() <= kSeenShare * fov.half_y_mm &&
           s.target_scanner.z() - sigma.z() >= fov.near_mm - 0.1 * (fov.far_mm - fov.near_mm) &&
           s.target_scanner.z() + sigma.z() <= fov.far_mm + 0.1 * (fov.far_mm - fov.near_mm);
  }

  ArtefactKind kind_;
  std::span<const View> views_;
  const StatedNoise& noise_;
  const CoverageSettings& settings_;
  const State& state_;
  const Coverage& coverage_;
  Sides sides_;
  int parameters_ = 0;
  Eigen::MatrixXd information_, covariance_;
  Mat6 points_;
  Quat upright_;
  std::vector<Offer> offers_;
};

Coverage look_at(ArtefactKind kind, std::span<const View> views, const CoverageSettings& settings, const Pose* X) {
  Coverage coverage;
  coverage.views = views.size();
  coverage.rotation_spread_axes_deg = rotation_spread_axes_deg(views);
  const Sides sides(settings.down_base);
  for (const View& view : views) {
    const Vec3 seen = target_seen(kind, view);
    coverage.cells[depth_cell(seen.z(), settings.fov) * kPlaces + place_cell(seen, settings.fov)] = true;
    if (X == nullptr) continue;
    const Vec3 axis = axis_of(view.T_base_flange * *X);
    if (deg_from_rad(angle_between_rad(axis, sides.down)) >= kTiltCounts_deg)
      coverage.sectors[sides.sector_of(axis)] = true;
  }
  return coverage;
}

}  // namespace

std::size_t Coverage::sectors_seen() const {
  return static_cast<std::size_t>(std::count(sectors.begin(), sectors.end(), true));
}
std::size_t Coverage::cells_seen() const {
  return static_cast<std::size_t>(std::count(cells.begin(), cells.end(), true));
}

double tilt_deg(const Pose& T_base_flange, const Pose& T_flange_scanner, const Vec3& down_base) {
  return deg_from_rad(angle_between_rad(axis_of(T_base_flange * T_flange_scanner), down_base));
}

Guide guide_next(ArtefactKind kind, std::span<const View> given, const StatedNoise& noise,
                 const CoverageSettings& settings, const Pose* start) {
  Guide guide;
  std::vector<View> views(given.begin(), given.end());
  std::optional<State> state;
  double inflate = 1.0;
  if (views.size() >= kViewsMin) {
    SolveSettings quick;
    quick.fov = settings.fov;
    quick.convention_test = false;
    const Result<HandEye> solved = solve(kind, views, noise, quick);
    if (solved && solved.value().s0 > kS0Max) guide.misfit_mm = solved.value().residual_mm.rms;
    if (solved && solved.value().determined && (solved.value().ok || start == nullptr)) {
      guide.solved = true;
      state = State{solved.value().T_flange_scanner, solved.value().targets};
      inflate = std::max(1.0, has_value(solved.value().s0) ? solved.value().s0 : 1.0);
      for (auto i = solved.value().rejected.rbegin(); i != solved.value().rejected.rend(); ++i)
        views.erase(views.begin() + static_cast<std::ptrdiff_t>(*i));
    }
  }
  if (!state && start != nullptr && !views.empty()) state = lean_on(kind, views, noise, *start);
  if (state)
    guide.T_flange_scanner = state->X;
  else if (start != nullptr)
    guide.T_flange_scanner = *start;
  guide.coverage = look_at(kind, views, settings, guide.T_flange_scanner ? &*guide.T_flange_scanner : nullptr);
  if (!state || views.empty()) return guide;

  const auto sigma = [&](std::span<const View> some) {
    return inflate * predict(kind, some, state->X, state->targets, noise, settings.fov).point_sigma_mm;
  };
  guide.coverage.point_sigma_mm = sigma(views);
  guide.next = Search(kind, views, noise, settings, *state, guide.coverage).best();
  if (guide.next) {
    View planned = views.front();
    planned.T_base_flange = guide.next->T_base_flange;
    views.push_back(planned);
    guide.next->point_sigma_mm = sigma(views);
  }
  if (has_value(guide.misfit_mm)) {
    guide.coverage.point_sigma_mm = kNoValue;
    if (guide.next) guide.next->point_sigma_mm = kNoValue;
  }
  return guide;
}

// Texts for the person at the robot. Sides are as seen from the robot's base along base +X; corners refer to the
// scanner's own axes, which its picture shows. The texts contain both, because "left" alone has been misunderstood.

namespace {

constexpr std::array<const char*, kSectors> kSides = {
    "away from the robot", "away and to the left",  "to the left",  "back and to the left",
    "back to the robot",   "back and to the right", "to the right", "away and to the right"};
constexpr std::array<const char*, kSectors> kBaseAxes = {"+X", "+X +Y", "+Y", "-X +Y", "-X", "-X -Y", "-Y", "+X -Y"};
constexpr std::array<const char*, kPlaces> kCorners = {"middle", "+x +y corner", "-x +y corner", "-x -y corner",
                                                       "+x -y corner"};
constexpr std::array<const char*, kDepths> kDistances = {"near", "mid-distance", "far"};

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

}  // namespace

std::string sector_words(std::size_t sector) {
  return kSides[sector % kSectors];
}

std::string place_words(std::size_t place, std::size_t depth) {
  return std::string(kDistances[depth % kDepths]) + " " + kCorners[place % kPlaces];
}

std::string suggestion_words(const Suggestion& s, ArtefactKind kind) {
  FixedString<320> text;
  text.printf(
      "tilt %.0f deg %s (the scanner looks towards base %s), roll %+.0f deg, %s in the %s of the view "
      "(x %.0f, y %.0f, %.0f mm from the scanner)",
      s.tilt_deg, kSides[s.sector % kSectors], kBaseAxes[s.sector % kSectors], s.roll_deg,
      kind == ArtefactKind::ball ? "ball" : "artefact", place_words(s.place, s.depth).c_str(), s.target_scanner.x(),
      s.target_scanner.y(), s.target_scanner.z());
  return std::string(text.view());
}

std::vector<std::string> missing_words(const Coverage& coverage, ArtefactKind kind) {
  std::vector<std::string> missing;
  FixedString<200> text;
  const double spread = coverage.rotation_spread_axes_deg[2];
  if (coverage.views > 1 && spread < kRotationSpreadAdvised_deg) {
    text.printf("the scanner was turned by %.1f deg (smallest principal spread), it should be 15: tilt more", spread);
    missing.emplace_back(text.view());
  }
  if (coverage.views < kViewsMin) return missing;  // too early; the suggestion is sufficient
  std::vector<std::string> sides;
  for (std::size_t sector = 0; sector < kSectors; ++sector)
    if (!coverage.sectors[sector]) sides.emplace_back(kSides[sector]);
  if (sides.size() > kSectors - 6) missing.push_back("not yet tilted " + joined(sides));
  for (std::size_t depth = 0; depth < kDepths; ++depth) {
    std::vector<std::string> places;
    for (std::size_t place = 0; place < kPlaces; ++place)
      if (!coverage.cells[depth * kPlaces + place]) places.emplace_back(kCorners[place]);
    if (places.size() > 2 && kind == ArtefactKind::ball)
      missing.push_back(std::string("not yet seen ") + kDistances[depth] + ": " + joined(places));
  }
  return missing;
}

}  // namespace slabd::calib
