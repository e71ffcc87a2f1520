// SPDX-License-Identifier: Apache-2.0
#pragma once

/// The distributions that studies rest on. `nu` are degrees of freedom, above 0. NaN for arguments out of range.
namespace slabd::cli::study {

/// The value that a share `p` (0..1, exclusive) of all standard normal values lies below.
[[nodiscard]] double normal_quantile(double p);
/// The same of Student's t.
[[nodiscard]] double student_quantile(double p, double nu);
/// The same of chi-squared.
[[nodiscard]] double chi_squared_quantile(double p, double nu);
/// How probable a |t| at least as large is by chance alone.
[[nodiscard]] double student_two_sided(double t, double nu);
/// How probable an F at least as large is by chance alone.
[[nodiscard]] double fisher_tail(double f, double nu_above, double nu_below);

}  // namespace slabd::cli::study
