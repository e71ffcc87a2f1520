// SPDX-License-Identifier: Apache-2.0
//
// Boost.Math, told to answer NaN where it would throw.
#include "cli/study/distributions.h"

#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <limits>

namespace slabd::cli::study {
namespace {

namespace rules = boost::math::policies;
using Quiet = rules::policy<rules::domain_error<rules::ignore_error>, rules::pole_error<rules::ignore_error>,
                            rules::overflow_error<rules::ignore_error>, rules::evaluation_error<rules::ignore_error>,
                            rules::promote_double<false>>;
using Normal = boost::math::normal_distribution<double, Quiet>;
using Student = boost::math::students_t_distribution<double, Quiet>;
using ChiSquared = boost::math::chi_squared_distribution<double, Quiet>;
using Fisher = boost::math::fisher_f_distribution<double, Quiet>;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

bool share(double p) {
  return p > 0.0 && p < 1.0;
}
bool freedom(double nu) {
  return nu > 0.0 && std::isfinite(nu);
}

}  // namespace

double normal_quantile(double p) {
  return share(p) ? boost::math::quantile(Normal(0.0, 1.0), p) : kNone;
}

double student_quantile(double p, double nu) {
  return share(p) && freedom(nu) ? boost::math::quantile(Student(nu), p) : kNone;
}

double chi_squared_quantile(double p, double nu) {
  return share(p) && freedom(nu) ? boost::math::quantile(ChiSquared(nu), p) : kNone;
}

double student_two_sided(double t, double nu) {
  if (!freedom(nu) || std::isnan(t)) return kNone;
  if (std::isinf(t)) return 0.0;
  return 2.0 * boost::math::cdf(boost::math::complement(Student(nu), std::abs(t)));
}

double fisher_tail(double f, double nu_above, double nu_below) {
  if (!freedom(nu_above) || !freedom(nu_below) || !(f >= 0.0)) return kNone;
  if (std::isinf(f)) return 0.0;
  return boost::math::cdf(boost::math::complement(Fisher(nu_above, nu_below), f));
}

}  // namespace slabd::cli::study
