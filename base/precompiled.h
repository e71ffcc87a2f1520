// SPDX-License-Identifier: Apache-2.0
#pragma once

/// Precompiled header of the includes used by nearly every file (CMakeLists.txt). No file may rely on it; sanitizer
/// builds do not use it.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "base/base.h"
#include "base/calibration.h"
