// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/result.h"

// The types of GLib and Aravis, whose headers only the .cpp files include.
using GError = struct _GError;
using ArvDevice = struct _ArvDevice;

/// Owners of Aravis' objects, and the features of a camera's node map.
namespace slabd::gateway::genicam {

/// Owner of a GError.
class Fault {
 public:
  ~Fault();
  Fault() = default;
  Fault(const Fault&) = delete;
  Fault& operator=(const Fault&) = delete;
  /// To be set by a function of Aravis; the error before is dropped.
  GError** out();
  explicit operator bool() const { return error_ != nullptr; }
  [[nodiscard]] const char* text() const;

 private:
  GError* error_ = nullptr;
};

struct Unref {
  void operator()(void* object) const;
};
template <typename Object>
using Owned = std::unique_ptr<Object, Unref>;

/// Features of the node map. Each function reports the feature's name in its error.
class Nodes {
 public:
  explicit Nodes(ArvDevice* device) : device_(device) {}

  [[nodiscard]] bool has(const char* feature) const;
  [[nodiscard]] Result<std::string> text(const char* feature) const;
  [[nodiscard]] Result<std::int64_t> integer(const char* feature) const;
  /// Also of a feature that the camera declares as an integer.
  [[nodiscard]] Result<double> real(const char* feature) const;
  [[nodiscard]] Result<bool> boolean(const char* feature) const;
  [[nodiscard]] Status set(const char* feature, const char* entry) const;
  [[nodiscard]] Status set(const char* feature, bool value) const;
  [[nodiscard]] Status execute(const char* feature) const;
  /// Entries of an enumeration, "A, B, C".
  [[nodiscard]] std::string entries(const char* feature) const;
  [[nodiscard]] std::vector<std::string> entry_list(const char* feature) const;
  /// Sets `feature` to the entry if it has another one; a camera without the feature is as it must be.
  [[nodiscard]] Status require(const char* feature, const char* entry) const;

 private:
  ArvDevice* device_;
};

}  // namespace slabd::gateway::genicam
