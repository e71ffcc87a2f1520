// SPDX-License-Identifier: Apache-2.0
#pragma once

/// The vocabulary that all rooms share. All headers of this room are public; this header includes them in reading
/// order.
// clang-format off
#include "base/limits.h"
#include "base/units.h"
#include "base/pose.h"
#include "base/fixed.h"
#include "base/arm.h"
#include "base/result.h"
#include "base/prng.h"
#include "base/items.h"
#include "base/gauge.h"
#include "base/recipe.h"
#include "base/thermal.h"
#include "base/records.h"
#include "base/design.h"
#include "base/packed_map.h"
#include "base/robot.h"
#include "base/plc.h"
// clang-format on
