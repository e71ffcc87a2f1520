// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/cad/cad_findings.h"

namespace slabd::cli {

/// Draws the model from obliquely above, from two sides, with the found faces in colours and a legend, as PNG: a person
/// sees in a minute if a face was mistaken. config: the file cannot be written.
[[nodiscard]] Status write_cad_picture(const std::string& path, const CadFindings& findings, const std::string& title);

}  // namespace slabd::cli
