// SPDX-License-Identifier: Apache-2.0
//
// Text forms of a master certificate and of visits. All later measurements depend on the certificate, so it is read
// strictly. Visits are written with all digits. They are solved again when the hand-eye calibration changes, and must
// then give the same corrections as a new capture.
#include <algorithm>
#include <cmath>
#include <map>

#include "calib/key_lines.h"
#include "calib/stations.h"

namespace slabd::calib {
namespace {

constexpr double kCoordinateMax_mm = 20'000.0;
constexpr double kUnitTolerance = 1e-3;  ///< of a direction as printed in a certificate
constexpr double kRightAngleMax = 5e-4;  ///< 0.03 deg; certificates give six digits
constexpr const char* kCertificateKeys =
    "id, date, issuer, slab_type, frame, U_mm, coverage_factor, temperature_c, seat, ball";

Vec3 vector_at(const std::vector<double>& values, std::size_t first) {
  return {values[first], values[first + 1], values[first + 2]};
}

bool station_from(const KeyLine& line, int& station) {
  double value = 0.0;
  if (line.words.empty() || !number_from(line.words[0], value)) return false;
  station = static_cast<int>(value);
  return static_cast<double>(station) == value && station >= 1 && station <= static_cast<int>(limits::kStationsMax);
}

MasterStation* find_station(MasterCertificate& certificate, int station) {
  for (MasterStation& s : certificate.stations)
    if (s.station == station) return &s;
  return nullptr;
}

void read_seat(KeyFile& file, const KeyLine& line, MasterCertificate& out) {
  int station = 0;
  if (!station_from(line, station)) return file.fault(line, "must begin with its station, 1..18");
  std::vector<double> v;
  if (!file.numbers(line, 1, kCoordinateMax_mm, v)) return;
  if (v.size() != 9)
    return file.fault(line,
                      "must be: station, x y z, the normal's three components, three of the direction from the "
                      "inner to the outer casing");
  if (find_station(out, station) != nullptr) return file.fault(line, "is a second entry of its station");
  const Vec3 normal = vector_at(v, 3);
  const Vec3 along = vector_at(v, 6);
  if (std::abs(normal.norm() - 1.0) > kUnitTolerance || std::abs(along.norm() - 1.0) > kUnitTolerance)
    return file.fault(line, "has directions that are not of length 1 within 0.001");
  if (std::abs(normal.normalized().dot(along.normalized())) > kRightAngleMax)
    return file.fault(line,
                      "has a direction that is not parallel to the seat: it must be at right angles to the normal");
  out.stations.push_back(master_seat(station, vector_at(v, 0), normal, along));
}

void read_ball(KeyFile& file, const KeyLine& line, MasterCertificate& out) {
  int station = 0;
  if (!station_from(line, station)) return file.fault(line, "must begin with its station, 1..18");
  std::vector<double> v;
  if (!file.numbers(line, 1, kCoordinateMax_mm, v)) return;
  if (v.size() != 3) return file.fault(line, "must be: station, x y z");
  MasterStation* s = find_station(out, station);
  if (s == nullptr) s = &out.stations.emplace_back(MasterStation{station, false, {}});
  if (s->is_seat) return file.fault(line, "belongs to a station that has a seat; it has one or the other");
  if (s->points_mm.size() == kStationBallsMax) return file.fault(line, "is more than eight balls at its station");
  s->points_mm.push_back(vector_at(v, 0));
}

/// Checks that the balls are not on a line, which would leave the rotation about it undetermined.
Status check_balls(const MasterStation& s, std::string_view file_name) {
  if (s.is_seat) return success();
  const auto file = static_cast<int>(file_name.size());
  if (s.points_mm.size() < kStationBallsMin)
    return error(Code::config, "%.*s: station %d has %zu balls, it needs %zu", file, file_name.data(), s.station,
                 s.points_mm.size(), kStationBallsMin);
  // The rotation about a line through the balls is determined by the height of the widest triangle over its longest
  // side.
  constexpr double kHeightLeast_mm = 50.0;
  double height_mm = 0.0;
  const std::vector<Vec3>& p = s.points_mm;
  for (std::size_t i = 0; i < p.size(); ++i)
    for (std::size_t j = i + 1; j < p.size(); ++j)
      for (std::size_t k = j + 1; k < p.size(); ++k) {
        const double longest_mm = std::max({(p[j] - p[i]).norm(), (p[k] - p[i]).norm(), (p[k] - p[j]).norm()});
        if (longest_mm > 0.0) height_mm = std::max(height_mm, (p[j] - p[i]).cross(p[k] - p[i]).norm() / longest_mm);
      }
  if (height_mm < kHeightLeast_mm)
    return error(
        Code::config,
        "%.*s: the balls of station %d are too near to each other or to a line: spread them over 100 mm both ways",
        file, file_name.data(), s.station);
  return success();
}

std::string vector_text(const Vec3& v) {
  return number_text(v.x()) + " " + number_text(v.y()) + " " + number_text(v.z());
}

}  // namespace

MasterStation master_seat(int station, const Vec3& p_mm, const Vec3& normal, const Vec3& along) {
  const Vec3 n = normal.normalized();
  const Vec3 a = (along - n * n.dot(along)).normalized();
  return {station, true, {p_mm, p_mm + kSeatLever_mm * n, p_mm + kSeatLever_mm * a}};
}

Result<MasterCertificate> parse_master_certificate(std::string_view text, std::string_view file_name) {
  Result<std::vector<KeyLine>> lines = key_lines(text, file_name);
  if (!lines.ok()) return lines.error();
  KeyFile file(std::move(lines.value()), file_name);
  MasterCertificate c;
  file.text("id", true, c.id);
  file.date("date", c.date);
  file.text("issuer", false, c.issuer);
  double slab_type = 0.0;
  file.number("slab_type", true, 1.0, 65'535.0, slab_type);
  c.slab_type = static_cast<std::uint16_t>(slab_type);
  std::string frame = "slab";
  file.text("frame", true, frame);
  double U_mm = kNoValue;
  double coverage = 2.0;
  file.number("U_mm", true, 1e-6, 5.0, U_mm);
  file.number("coverage_factor", false, 1.0, 4.0, coverage);
  file.number("temperature_c", false, -20.0, 60.0, c.temperature_c);
  c.sigma_mm = U_mm / coverage;
  for (const KeyLine* line : file.all("seat")) read_seat(file, *line, c);
  for (const KeyLine* line : file.all("ball")) read_ball(file, *line, c);
  if (const Status status = file.finish(kCertificateKeys); !status.ok()) return status.error();
  const auto size = static_cast<int>(file_name.size());
  if (frame != "slab" && frame != "base")
    return error(Code::config, "%.*s: frame is \"%.40s\", allowed are slab and base", size, file_name.data(),
                 frame.c_str());
  c.frame = frame == "slab" ? MasterCertificate::Frame::slab : MasterCertificate::Frame::base;
  if (c.stations.empty())
    return error(Code::config, "%.*s: no station is certified: it needs lines 'seat = ...' or 'ball = ...'", size,
                 file_name.data());
  std::sort(c.stations.begin(), c.stations.end(),
            [](const MasterStation& a, const MasterStation& b) { return a.station < b.station; });
  for (const MasterStation& s : c.stations)
    if (const Status status = check_balls(s, file_name); !status.ok()) return status.error();
  return c;
}

std::string master_certificate_text(const MasterCertificate& c) {
  std::string text = "id = \"" + c.id + "\"\ndate = " + c.date + "\n";
  if (!c.issuer.empty()) text += "issuer = \"" + c.issuer + "\"\n";
  text += "slab_type = " + std::to_string(c.slab_type) + "\n";
  text += std::string("frame = ") + (c.frame == MasterCertificate::Frame::slab ? "slab" : "base") + "\n";
  // Written with k = 1 to keep all digits.
  text += "coverage_factor = 1\nU_mm = " + number_text(c.sigma_mm) + "\n";
  text += "temperature_c = " + number_text(c.temperature_c) + "\n";
  for (const MasterStation& s : c.stations) {
    if (!s.is_seat) {
      for (const Vec3& p : s.points_mm) text += "ball = " + std::to_string(s.station) + "  " + vector_text(p) + "\n";
      continue;
    }
    const Vec3& p = s.points_mm[0];
    text += "seat = " + std::to_string(s.station) + "  " + vector_text(p) + "  " +
            vector_text((s.points_mm[1] - p) / kSeatLever_mm) + "  " +
            vector_text((s.points_mm[2] - p) / kSeatLever_mm) + "\n";
  }
  return text;
}

std::optional<StationVisit> seat_visit(const BlockResult& block, const Pose& T_base_flange, std::string_view round) {
  const CasingFeature& inner = block.casing_inner;
  const CasingFeature& outer = block.casing_outer;
  const bool measured =
      block.registration.status == RegistrationStatus::converged && block.seat.plane.ok && inner.ok && outer.ok;
  if (!measured) return std::nullopt;
  // All points are in the block's registered frame; the pose of that frame converts them to the scanner frame.
  const MasterStation seat = master_seat(block.station, 0.5 * (inner.centre + outer.centre), block.seat.plane.normal,
                                         outer.centre - inner.centre);
  StationVisit visit{block.station, std::string(round), T_base_flange, {}};
  for (const Vec3& p : seat.points_mm) visit.points_mm.push_back(block.registration.T_scanner_block * p);
  for (const Vec3& p : visit.points_mm)
    if (!p.allFinite()) return std::nullopt;
  for (const Item& item : block.items)
    if (item.id == ItemId::seat_slope) visit.local_slope_rad = rad_from_deg(item.value);
  return visit;
}

std::string visits_text(std::span<const StationVisit> visits) {
  std::string text =
      "# slabd station visits: station, round, T_base_flange as reported (x y z qw qx qy qz), points as\n"
      "# the scanner saw them (mm, scanner frame, in the certificate's order)\n";
  std::vector<std::string_view> told;
  for (const StationVisit& visit : visits) {
    if (!visit.hand_eye_id.empty() && std::find(told.begin(), told.end(), visit.round) == told.end()) {
      text += "taken_with = \"" + visit.round + "\" " + visit.hand_eye_id + "\n";
      told.push_back(visit.round);
    }
    text += "visit = " + std::to_string(visit.station) + " \"" + visit.round + "\" ";
    for (const double x : visit.T_base_flange.to_array()) text += " " + number_text(x);
    for (const Vec3& p : visit.points_mm) text += "  " + vector_text(p);
    text += "\n";
  }
  return text;
}

Result<std::vector<StationVisit>> parse_visits(std::string_view text, std::string_view file_name) {
  Result<std::vector<KeyLine>> lines = key_lines(text, file_name);
  if (!lines.ok()) return lines.error();
  KeyFile file(std::move(lines.value()), file_name);
  std::vector<StationVisit> visits;
  std::map<std::string, std::string> taken_with;
  const std::vector<const KeyLine*> taken_with_lines = file.all("taken_with");
  for (const KeyLine* line : taken_with_lines) {
    if (line->words.size() != 2)
      file.fault(*line, "must be: round, id of the hand-eye calibration in force then");
    else if (!taken_with.emplace(line->words[0], line->words[1]).second)
      file.fault(*line, "names a round that another line names");
  }
  for (const KeyLine* line : file.all("visit")) {
    StationVisit visit;
    std::vector<double> v;
    if (!station_from(*line, visit.station) || line->words.size() < 2) {
      file.fault(*line, "must begin with station (1..18) and round");
      break;
    }
    visit.round = line->words[1];
    if (!file.numbers(*line, 2, 100'000.0, v)) break;
    if (v.size() < 7 + 3 * kStationBallsMin || v.size() > 7 + 3 * kStationBallsMax || (v.size() - 7) % 3 != 0) {
      file.fault(*line, "must be: station, round, x y z qw qx qy qz, then three to eight points x y z");
      break;
    }
    const Quat q(v[3], v[4], v[5], v[6]);
    if (std::abs(q.norm() - 1.0) > kUnitTolerance) {
      file.fault(*line, "has a quaternion (qw qx qy qz) that is not of length 1 within 0.001");
      break;
    }
    // As written, because normalising again would change the last bits of the captured values.
    visit.T_base_flange.translation_mm = vector_at(v, 0);
    visit.T_base_flange.rotation = std::abs(q.norm() - 1.0) > 1e-12 ? Quat(q.normalized()) : q;
    for (std::size_t i = 7; i < v.size(); i += 3) visit.points_mm.push_back(vector_at(v, i));
    visits.push_back(std::move(visit));
  }
  for (const KeyLine* line : taken_with_lines)
    if (line->words.size() == 2 && std::none_of(visits.begin(), visits.end(), [&](const StationVisit& visit) {
          return visit.round == line->words[0];
        }))
      file.fault(*line, "names a round that has no visit");
  if (const Status status = file.finish("visit, taken_with"); !status.ok()) return status.error();
  for (StationVisit& visit : visits)
    if (const auto with = taken_with.find(visit.round); with != taken_with.end()) visit.hand_eye_id = with->second;
  if (visits.empty())
    return error(Code::config, "%.*s: no visits: it needs lines 'visit = ...'", static_cast<int>(file_name.size()),
                 file_name.data());
  return visits;
}

}  // namespace slabd::calib
