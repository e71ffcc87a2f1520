// SPDX-License-Identifier: Apache-2.0
#pragma once

/// What nearly every file includes, read by the compiler once for all of them: CMakeLists.txt. No file may count on it;
/// the builds with sanitizers go without.
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
