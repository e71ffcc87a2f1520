// SPDX-License-Identifier: Apache-2.0
//
// The upper tail of chi-square with n degrees of freedom is a finite sum: with h = x / 2
//
//     n even: exp(-h) sum_{j < n/2} h^j / j!
//     n odd:  erfc(sqrt h) + exp(-h) sum_{j < (n-1)/2} h^(j + 1/2) / Gamma(j + 3/2)
//
// Everything is kept as a logarithm, so that a residual of a thousand sigmas is still told from one of two thousand.
#include "calib/chi_square.h"

#include <algorithm>
#include <cmath>

#include "base/units.h"

namespace slabd::calib {
namespace {

/// log(erfc(z)), z >= 0.
double log_erfc(double z) {
  if (z < 20.0) return std::log(std::erfc(z));
  return -z * z - std::log(z * std::sqrt(kPi)) + std::log1p(-0.5 / (z * z));
}

double log_sum(double a, double b) {
  const double high = std::max(a, b);
  return high + std::log(std::exp(a - high) + std::exp(b - high));
}

double log_tail(double x, int freedom) {
  const double h = 0.5 * x;
  const double log_h = std::log(h);
  const bool odd = freedom % 2 == 1;
  double sum = odd ? log_erfc(std::sqrt(h)) : -h;
  for (int j = odd ? 0 : 1; j < freedom / 2; ++j) {
    const double power = odd ? j + 0.5 : j;
    sum = log_sum(sum, power * log_h - h - std::lgamma(power + 1.0));
  }
  return sum;
}

}  // namespace

double normal_sigmas(double x, int freedom) {
  if (!std::isfinite(x) || freedom < 1) return x;
  if (x <= 0.0) return 0.0;
  const double wanted = log_tail(x, freedom);
  double low = 0.0;
  double high = std::sqrt(x) + 1.0;  // more degrees of freedom make the same sum less rare
  for (int k = 0; k < 80; ++k) {
    const double middle = 0.5 * (low + high);
    (log_erfc(middle / std::sqrt(2.0)) > wanted ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

double chi_square_median(int freedom) {
  const double n = freedom;
  const double third = 1.0 - 2.0 / (9.0 * n);
  return n * third * third * third;
}

}  // namespace slabd::calib
