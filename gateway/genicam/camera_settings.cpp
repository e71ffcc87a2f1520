// SPDX-License-Identifier: Apache-2.0
// Settings before the first exposure: everything in the node map that gives the bytes of a frame a meaning, trigger,
// packets, clock, and the identity of the camera.
#include <arv.h>
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <set>
#include <thread>

#include "gateway/genicam/camera_parts.h"
#include "hal/scan/scan_stream.h"

namespace slabd::gateway::genicam {
namespace {

/// Bytes of a name in the identity's text: 64 bytes hold model, serial number and firmware of at most these, three
/// blanks and eight digits.
constexpr std::size_t kModelBytes = 20;
constexpr std::size_t kSerialBytes = 16;
constexpr std::size_t kFirmwareBytes = 16;
/// Features that a settings checksum visits at most; node maps of area scanners have some hundreds.
constexpr std::size_t kFeaturesMax = 5'000;
/// Bootstrap registers (GigE Vision 2.0, 28): control of the time stamp (2: latch) and the latched value.
constexpr std::uint64_t kTimestampControl = 0x0944;
constexpr std::uint64_t kTimestampHigh = 0x0948;
constexpr std::uint64_t kTimestampLow = 0x094C;
constexpr std::uint32_t kLatch = 2;

std::string plain(const char* text) {
  std::string out;
  for (const char* c = text == nullptr ? "" : text; *c != '\0'; ++c)
    out += static_cast<unsigned char>(*c) > ' ' && static_cast<unsigned char>(*c) < 0x7F ? *c : '-';
  return out.empty() ? "-" : out;
}

/// SFNC's ComponentIDValue, for cameras that do not have the feature. Part of a frame's leader.
std::int64_t standard_component_id(std::string_view component) {
  constexpr std::array<std::pair<std::string_view, std::int64_t>, 9> kIds = {{{"Intensity", 1},
                                                                              {"Infrared", 2},
                                                                              {"Ultraviolet", 3},
                                                                              {"Range", 4},
                                                                              {"Reflectance", 5},
                                                                              {"Confidence", 6},
                                                                              {"Scatter", 7},
                                                                              {"Disparity", 8},
                                                                              {"Multispectral", 9}}};
  for (const auto& [name, id] : kIds)
    if (name == component) return id;
  return -1;
}

/// True for features that describe transport, time or events, or select what others show: they are not settings of the
/// measurement.
bool is_transport(std::string_view name) {
  constexpr std::array<std::string_view, 12> kPrefixes = {"Gev",   "Ptp",      "Arv",     "Timestamp",
                                                          "Event", "Transfer", "Action",  "Test",
                                                          "Chunk", "Device",   "UserSet", "Acquisition"};
  for (const std::string_view prefix : kPrefixes)
    if (name.starts_with(prefix)) return true;
  return name.ends_with("Selector") || name == "TriggerMode" || name == "TriggerSource" || name == "ComponentEnable" ||
         name == "PayloadSize" || name.find("Temperature") != std::string_view::npos;
}

/// Adds "name=value" lines of all writable features below a category, in the node map's order.
void add_settings(const Nodes& nodes, ArvDevice* device, ArvGcNode* category, std::set<std::string>& seen,
                  std::string& lines) {
  for (const GSList* entry = arv_gc_category_get_features(ARV_GC_CATEGORY(category)); entry != nullptr;
       entry = entry->next) {
    const std::string name = static_cast<const char*>(entry->data);
    if (seen.size() >= kFeaturesMax || !seen.insert(name).second) continue;
    ArvGcNode* node = arv_device_get_feature(device, name.c_str());
    if (node == nullptr) continue;
    if (ARV_IS_GC_CATEGORY(node)) {
      add_settings(nodes, device, node, seen, lines);
      continue;
    }
    if (is_transport(name) || !nodes.has(name.c_str()) || ARV_IS_GC_COMMAND(node)) continue;
    // Aravis 0.8.26 reports WO also for features that can be read and written.
    if (arv_device_get_feature_access_mode(device, name.c_str()) == ARV_GC_ACCESS_MODE_RO) continue;
    Fault fault;
    const char* value = arv_gc_feature_node_get_value_as_string(ARV_GC_FEATURE_NODE(node), fault.out());
    if (!fault && value != nullptr) lines += name + "=" + value + "\n";
  }
}

}  // namespace

std::optional<std::uint64_t> Camera::Aravis::clock_ns() const {
  if (tick_frequency == 0) return std::nullopt;
  Fault fault;
  std::uint32_t high = 0;
  std::uint32_t low = 0;
  if (arv_device_write_register(device, kTimestampControl, kLatch, fault.out()) == FALSE ||
      arv_device_read_register(device, kTimestampHigh, &high, fault.out()) == FALSE ||
      arv_device_read_register(device, kTimestampLow, &low, fault.out()) == FALSE)
    return std::nullopt;
  const std::uint64_t ticks = (std::uint64_t{high} << 32U) | low;
  return ticks / tick_frequency * 1'000'000'000U + ticks % tick_frequency * 1'000'000'000U / tick_frequency;
}

Status Camera::configure() {
  const Nodes nodes = aravis_->nodes();
  // An earlier program may have left it running.
  static_cast<void>(nodes.execute("AcquisitionStop"));
  if (Status status = choose_component(); !status) return status;
  if (Status status = check_geometry(); !status) return status;
  if (Status status = read_axes(); !status) return status;
  if (Status status = set_trigger(); !status) return status;
  if (Status status = set_packet_size(); !status) return status;
  test_clock();
  return read_identity();
}

Status Camera::choose_component() {
  const Nodes nodes = aravis_->nodes();
  component_id_ = standard_component_id(settings_.component);
  if (!nodes.has("ComponentSelector")) {
    if (settings_.component != "Range")
      return error(
          Code::config,
          "feature ComponentSelector: the camera does not have it; allowed is [genicam] component = \"Range\"");
    return success();
  }
  const std::vector<std::string> all = nodes.entry_list("ComponentSelector");
  if (std::find(all.begin(), all.end(), settings_.component) == all.end())
    return error(Code::config, "feature ComponentSelector: [genicam] component is %s, the camera has %s",
                 settings_.component.c_str(), nodes.entries("ComponentSelector").c_str());
  // Other components only cost time on the network; a camera that always sends some may keep them.
  for (const std::string& other : all) {
    if (other == settings_.component) continue;
    if (!nodes.set("ComponentSelector", other.c_str()) || !nodes.has("ComponentEnable")) continue;
    const Result<bool> enabled = nodes.boolean("ComponentEnable");
    if (enabled && enabled.value() && !nodes.set("ComponentEnable", false))
      notes_.push_back(fmt::format("the camera sends component {}, too", other));
  }
  if (Status status = nodes.set("ComponentSelector", settings_.component.c_str()); !status) return status;
  if (nodes.has("ComponentEnable")) {
    const Result<bool> enabled = nodes.boolean("ComponentEnable");
    if (!enabled || !enabled.value())
      if (Status status = nodes.set("ComponentEnable", true); !status) return status;
  }
  if (nodes.has("ComponentIDValue")) {
    const Result<std::int64_t> id = nodes.integer("ComponentIDValue");
    if (!id) return id.error();
    component_id_ = id.value();
  }
  return success();
}

Status Camera::check_geometry() {
  const Nodes nodes = aravis_->nodes();
  if (Status status = nodes.require("Scan3dOutputMode", "CalibratedABC_Grid"); !status) return status;
  if (Status status = nodes.require("Scan3dCoordinateSystem", "Cartesian"); !status) return status;
  // Transformed points are not in the scanner's own frame, which the hand-eye calibration needs.
  if (Status status = nodes.require("Scan3dCoordinateSystemReference", "Anchor"); !status) return status;
  if (nodes.has("Scan3dDistanceUnit")) {
    const Result<std::string> unit = nodes.text("Scan3dDistanceUnit");
    if (!unit) return unit.error();
    if (unit.value() != "Millimeter")
      if (Status status = nodes.require("Scan3dDistanceUnit", "Millimeter"); !status) return status;
  } else if (settings_.unit_required) {
    return error(Code::config,
                 "feature Scan3dDistanceUnit: the camera does not state its unit; if its manual says mm, set [genicam] "
                 "unit_check = \"if_stated\"");
  } else {
    notes_.emplace_back("the camera does not state its unit: mm, as [genicam] unit_check permits");
  }
  Result<std::string> format = nodes.text("PixelFormat");
  if (!format) return format.error();
  if (!point_format_named(format.value())) {
    const std::vector<std::string> all = nodes.entry_list("PixelFormat");
    const auto usable =
        std::find_if(all.begin(), all.end(), [](const std::string& e) { return point_format_named(e).ok(); });
    if (usable == all.end())
      return error(Code::config, "feature PixelFormat: the camera has %s, allowed are %s",
                   nodes.entries("PixelFormat").c_str(), point_format_names().c_str());
    if (Status status = nodes.set("PixelFormat", usable->c_str()); !status) return status;
    format = *usable;
  }
  layout_.format = point_format_named(format.value()).value();
  const Result<std::int64_t> width = nodes.integer("Width");
  if (!width) return width.error();
  const Result<std::int64_t> height = nodes.integer("Height");
  if (!height) return height.error();
  constexpr std::int64_t kMax = limits::kScanPointsMax;
  if (width.value() < 1 || width.value() > kMax || height.value() < 1 || height.value() > kMax)
    return error(Code::config, "features Width and Height: found %lld and %lld, allowed are %lld points in all",
                 static_cast<long long>(width.value()), static_cast<long long>(height.value()),
                 static_cast<long long>(kMax));
  layout_.width = static_cast<std::uint32_t>(width.value());
  layout_.height = static_cast<std::uint32_t>(height.value());
  const Result<std::int64_t> payload = nodes.integer("PayloadSize");
  if (!payload) return payload.error();
  if (payload.value() < static_cast<std::int64_t>(layout_.bytes()) ||
      payload.value() > static_cast<std::int64_t>(kFrameBytesMax))
    return error(Code::config, "feature PayloadSize: found %lld bytes, allowed are %zu (%u x %u points of %s) to %zu",
                 static_cast<long long>(payload.value()), layout_.bytes(), layout_.width, layout_.height,
                 info(layout_.format).name, kFrameBytesMax);
  link_.payload_bytes = static_cast<std::size_t>(payload.value());
  return success();
}

Status Camera::read_axes() {
  const Nodes nodes = aravis_->nodes();
  constexpr std::array<const char*, 3> kAxes = {"CoordinateA", "CoordinateB", "CoordinateC"};
  const bool is_float = info(layout_.format).coordinate_bytes == 4;
  if (!nodes.has("Scan3dCoordinateSelector")) {
    if (!is_float)
      return error(Code::config,
                   "feature Scan3dCoordinateSelector: the camera does not have it, and %s needs scale and offset of "
                   "each coordinate; allowed without it are Coord3D_ABC32f and Coord3D_ABC32f_Planar",
                   info(layout_.format).name);
    return check(layout_);
  }
  for (std::size_t i = 0; i < kAxes.size(); ++i) {
    if (Status status = nodes.set("Scan3dCoordinateSelector", kAxes[i]); !status) return status;
    Axis& axis = layout_.axes[i];
    const auto read = [&](const char* feature, double& out) -> Status {
      if (!nodes.has(feature)) {
        if (is_float) return success();
        return error(Code::config, "feature %s of %s: the camera does not have it, %s needs it", feature, kAxes[i],
                     info(layout_.format).name);
      }
      const Result<double> found = nodes.real(feature);
      if (!found) return found.error();
      out = found.value();
      return success();
    };
    if (Status status = read("Scan3dCoordinateScale", axis.scale); !status) return status;
    if (Status status = read("Scan3dCoordinateOffset", axis.offset_mm); !status) return status;
    if (!nodes.has("Scan3dInvalidDataFlag")) continue;
    const Result<bool> flag = nodes.boolean("Scan3dInvalidDataFlag");
    if (!flag) return flag.error();
    axis.has_invalid = flag.value();
    if (!axis.has_invalid) continue;
    const Result<double> invalid = nodes.real("Scan3dInvalidDataValue");
    if (!invalid) return invalid.error();
    axis.invalid = invalid.value();
  }
  if (!is_float && std::none_of(layout_.axes.begin(), layout_.axes.end(), [](const Axis& a) { return a.has_invalid; }))
    return error(Code::config,
                 "feature Scan3dInvalidDataFlag: false for all coordinates; %s needs a value for missing points, "
                 "allowed is true for one coordinate at least",
                 info(layout_.format).name);
  return check(layout_);
}

Status Camera::set_trigger() {
  const Nodes nodes = aravis_->nodes();
  const bool software = settings_.trigger == config::GenicamSettings::Trigger::software;
  if (software && !nodes.has("TriggerSoftware"))
    return error(
        Code::config,
        "feature TriggerSoftware: the camera does not have it; allowed is [genicam] trigger = \"acquisition_start\"");
  if (nodes.has("TriggerSelector")) {
    for (const std::string& other : nodes.entry_list("TriggerSelector")) {
      if (other == "FrameStart") continue;
      if (nodes.set("TriggerSelector", other.c_str())) static_cast<void>(nodes.set("TriggerMode", "Off"));
    }
    if (Status status = nodes.set("TriggerSelector", "FrameStart"); !status) return status;
  }
  if (!software) {
    if (nodes.has("TriggerMode"))
      if (Status status = nodes.set("TriggerMode", "Off"); !status) return status;
    return nodes.set("AcquisitionMode", "SingleFrame");
  }
  if (Status status = nodes.set("TriggerMode", "On"); !status) return status;
  if (Status status = nodes.set("TriggerSource", "Software"); !status) return status;
  return nodes.has("AcquisitionMode") ? nodes.set("AcquisitionMode", "Continuous") : success();
}

Status Camera::set_packet_size() {
  ArvCamera* camera = aravis_->camera.get();
  Fault fault;
  // Never by itself: it tries sizes above the MTU and then loses most frames.
  arv_camera_gv_set_packet_size_adjustment(camera, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
  // A packet socket needs CAP_NET_RAW, which this program does not have.
  arv_camera_gv_set_stream_options(camera, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
  arv_camera_gv_set_packet_size(camera, settings_.packet_bytes, fault.out());
  if (fault)
    return error(Code::config, "feature GevSCPSPacketSize: [genicam] packet_size = %d is refused: %s",
                 settings_.packet_bytes, fault.text());
  link_.packet_bytes = static_cast<int>(arv_camera_gv_get_packet_size(camera, fault.out()));
  if (fault || link_.packet_bytes != settings_.packet_bytes)
    return error(Code::config,
                 "feature GevSCPSPacketSize: [genicam] packet_size is %d, the camera uses %d; allowed is the camera's "
                 "number if it fits the network's MTU",
                 settings_.packet_bytes, link_.packet_bytes);
  std::uint32_t capability = 0;
  constexpr std::uint64_t kCapability = 0x0934;  // GigE Vision 2.0, 28: GVCP capability, bit 2 from the right: resend
  constexpr std::uint32_t kResendBit = 1U << 2U;
  link_.resends = arv_device_read_register(aravis_->device, kCapability, &capability, fault.out()) != FALSE &&
                  (capability & kResendBit) != 0;
  if (!link_.resends) notes_.emplace_back("the camera cannot send lost packets again: each lost packet costs a scan");
  return success();
}

void Camera::test_clock() {
  Fault fault;
  aravis_->tick_frequency = arv_gv_device_get_timestamp_tick_frequency(ARV_GV_DEVICE(aravis_->device), fault.out());
  const std::optional<std::uint64_t> first = aravis_->clock_ns();
  std::this_thread::sleep_for(std::chrono::milliseconds(2));
  const std::optional<std::uint64_t> second = aravis_->clock_ns();
  link_.has_clock = first && second && *second > *first;
  if (!link_.has_clock)
    notes_.push_back(
        fmt::format("the camera's clock cannot be read: after an exposure without a frame the next one waits {:.0f} s",
                    settings_.timeout_s));
}

Status Camera::read_identity() {
  const Nodes nodes = aravis_->nodes();
  const auto text_of = [&](std::initializer_list<const char*> features) {
    for (const char* feature : features)
      if (nodes.has(feature))
        if (const Result<std::string> found = nodes.text(feature); found && !found.value().empty())
          return found.value();
    return std::string();
  };
  identity_.vendor = text_of({"DeviceVendorName"});
  identity_.model = text_of({"DeviceModelName"});
  identity_.serial = text_of({"DeviceSerialNumber", "DeviceID"});
  identity_.firmware = text_of({"DeviceFirmwareVersion", "DeviceVersion"});
  if (identity_.model.empty() || identity_.serial.empty())
    return error(Code::config,
                 "features DeviceModelName and DeviceSerialNumber: found \"%s\" and \"%s\"; without both an acceptance "
                 "cannot be bound to the camera",
                 identity_.model.c_str(), identity_.serial.c_str());
  std::string lines = fmt::format("vendor={}\nmodel={}\nserial={}\nfirmware={}\n", identity_.vendor, identity_.model,
                                  identity_.serial, identity_.firmware);
  if (ArvGcNode* root = arv_device_get_feature(aravis_->device, "Root"); root != nullptr && ARV_IS_GC_CATEGORY(root)) {
    std::set<std::string> seen;
    add_settings(nodes, aravis_->device, root, seen, lines);
  }
  lines += fmt::format("component={}\nformat={}\n", settings_.component, info(layout_.format).name);
  for (const Axis& axis : layout_.axes)
    lines +=
        fmt::format("axis={:.17g} {:.17g} {} {:.17g}\n", axis.scale, axis.offset_mm, axis.has_invalid, axis.invalid);
  identity_.settings_crc = hal::crc32c(std::as_bytes(std::span(lines)));
  identity_.text = fmt::format("{} {} {} {:08x}", plain(identity_.model.c_str()).substr(0, kModelBytes),
                               plain(identity_.serial.c_str()).substr(0, kSerialBytes),
                               plain(identity_.firmware.c_str()).substr(0, kFirmwareBytes), identity_.settings_crc);
  return success();
}

}  // namespace slabd::gateway::genicam
