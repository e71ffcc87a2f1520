// SPDX-License-Identifier: Apache-2.0
//
// The bearing plane alone with CGAL's Efficient RANSAC. The method requires a normal for every point; the true normals
// are supplied, so the time is that of the detection.
#include <CGAL/Point_set_3.h>
#include <CGAL/Shape_detection/Efficient_RANSAC.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/property_map.h>
#include <CGAL/version.h>

#include <cmath>

#include "bench/peers/peer.h"

namespace {

using Kernel = CGAL::Simple_cartesian<double>;
using Oriented = std::pair<Kernel::Point_3, Kernel::Vector_3>;
using Cloud = std::vector<Oriented>;
using Traits = CGAL::Shape_detection::Efficient_RANSAC_traits<Kernel, Cloud, CGAL::First_of_pair_property_map<Oriented>,
                                                              CGAL::Second_of_pair_property_map<Oriented>>;
using Ransac = CGAL::Shape_detection::Efficient_RANSAC<Traits>;
using slabd::bench::Peer;
using slabd::bench::PlaneAnswer;

void run_plane(Peer& peer, bool refit) {
  const std::vector<float> xyz = peer.floats("crop.f32");
  const slabd::bench::Direction n =
      slabd::bench::rotated(slabd::bench::inverse(peer.truth().T_block_scanner), peer.truth().seat_normal_block);
  Cloud cloud;
  cloud.reserve(xyz.size() / 3);
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3)
    cloud.emplace_back(Kernel::Point_3(xyz[i], xyz[i + 1], xyz[i + 2]), Kernel::Vector_3(n[0], n[1], n[2]));
  peer.begin();
  Ransac ransac;
  ransac.set_input(cloud);
  ransac.add_shape_factory<CGAL::Shape_detection::Plane<Traits>>();
  Ransac::Parameters parameters;
  parameters.probability = 0.01;
  parameters.min_points = cloud.size() / 2;
  parameters.epsilon = slabd::bench::kPlaneInlier_mm;
  parameters.cluster_epsilon = 1.0;
  parameters.normal_threshold = 0.9;
  ransac.detect(parameters);
  PlaneAnswer plane;
  if (!ransac.shapes().empty()) {
    const auto* found = dynamic_cast<const CGAL::Shape_detection::Plane<Traits>*>(ransac.shapes().begin()->get());
    const Kernel::Vector_3 normal = found->plane_normal();
    const Kernel::Plane_3 equation = static_cast<Kernel::Plane_3>(*found);
    const double length = std::sqrt(normal.squared_length());
    plane.normal = {normal.x() / length, normal.y() / length, normal.z() / length};
    const double scale = std::sqrt(equation.orthogonal_vector().squared_length());
    const double sign = equation.orthogonal_vector() * normal < 0.0 ? -1.0 : 1.0;
    plane.offset_mm = -sign * equation.d() / scale;
  }
  peer.lap("plane");
  if (refit) {
    slabd::bench::refit_plane(xyz.data(), xyz.size() / 3, 3, slabd::bench::kPlaneInlier_mm, plane);
    peer.lap("refit");
  }
  peer.end();
  peer.score_normal(plane.normal);
}

}  // namespace

int main(int argc, char** argv) {
  Peer peer(argc, argv, "CGAL", CGAL_VERSION_STR);
  for (int i = 0; i < peer.repeats(); ++i) {
    if (peer.job() == "plane") run_plane(peer, false);
    if (peer.job() == "plane-refit") run_plane(peer, true);
  }
  return peer.print();
}
