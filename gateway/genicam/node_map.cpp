// SPDX-License-Identifier: Apache-2.0
#include "gateway/genicam/node_map.h"

#include <arv.h>

#include <algorithm>

namespace slabd::gateway::genicam {
namespace {

Error unread(const char* feature, const Fault& fault) {
  return error(Code::config, "feature %s: cannot be read: %s", feature, fault.text());
}

}  // namespace

Fault::~Fault() {
  g_clear_error(&error_);
}
GError** Fault::out() {
  g_clear_error(&error_);
  return &error_;
}
const char* Fault::text() const {
  return error_ == nullptr ? "unknown error" : error_->message;
}

void Unref::operator()(void* object) const {
  g_object_unref(object);
}

bool Nodes::has(const char* feature) const {
  Fault fault;
  return arv_device_is_feature_available(device_, feature, fault.out()) && !fault;
}

Result<std::string> Nodes::text(const char* feature) const {
  Fault fault;
  const char* found = arv_device_get_string_feature_value(device_, feature, fault.out());
  if (fault || found == nullptr) return unread(feature, fault);
  return std::string(found);
}

Result<std::int64_t> Nodes::integer(const char* feature) const {
  Fault fault;
  const gint64 found = arv_device_get_integer_feature_value(device_, feature, fault.out());
  if (fault) return unread(feature, fault);
  return std::int64_t{found};
}

Result<double> Nodes::real(const char* feature) const {
  Fault fault;
  const double found = arv_device_get_float_feature_value(device_, feature, fault.out());
  if (!fault) return found;
  const Result<std::int64_t> whole = integer(feature);
  if (!whole) return unread(feature, fault);
  return static_cast<double>(whole.value());
}

Result<bool> Nodes::boolean(const char* feature) const {
  Fault fault;
  const bool found = arv_device_get_boolean_feature_value(device_, feature, fault.out()) != FALSE;
  if (fault) return unread(feature, fault);
  return found;
}

Status Nodes::set(const char* feature, const char* entry) const {
  Fault fault;
  arv_device_set_string_feature_value(device_, feature, entry, fault.out());
  if (fault)
    return error(Code::config, "feature %s: cannot be set to %s: %s; allowed are %s", feature, entry, fault.text(),
                 entries(feature).c_str());
  return success();
}

Status Nodes::set(const char* feature, bool value) const {
  Fault fault;
  arv_device_set_boolean_feature_value(device_, feature, value ? TRUE : FALSE, fault.out());
  if (fault)
    return error(Code::config, "feature %s: cannot be set to %s: %s", feature, value ? "true" : "false", fault.text());
  return success();
}

Status Nodes::execute(const char* feature) const {
  Fault fault;
  arv_device_execute_command(device_, feature, fault.out());
  if (fault) return error(Code::scanner_offline, "feature %s: %s", feature, fault.text());
  return success();
}

std::string Nodes::entries(const char* feature) const {
  std::string all;
  for (const std::string& entry : entry_list(feature)) all += (all.empty() ? "" : ", ") + entry;
  return all.empty() ? "none" : all;
}

std::vector<std::string> Nodes::entry_list(const char* feature) const {
  Fault fault;
  guint count = 0;
  const char** found =
      arv_device_dup_available_enumeration_feature_values_as_strings(device_, feature, &count, fault.out());
  std::vector<std::string> all;
  for (guint i = 0; found != nullptr && i < count; ++i) all.emplace_back(found[i]);
  g_free(static_cast<void*>(found));
  return all;
}

Status Nodes::require(const char* feature, const char* entry) const {
  if (!has(feature)) return success();
  const Result<std::string> found = text(feature);
  if (found && found.value() == entry) return success();
  const std::vector<std::string> all = entry_list(feature);
  if (std::find(all.begin(), all.end(), entry) == all.end())
    return error(Code::config, "feature %s: found %s, needed is %s, the camera has %s", feature,
                 found ? found.value().c_str() : "nothing", entry, entries(feature).c_str());
  return set(feature, entry);
}

}  // namespace slabd::gateway::genicam
