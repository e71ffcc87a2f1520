// SPDX-License-Identifier: Apache-2.0
#include "gateway/genicam/camera.h"

#include <arpa/inet.h>
#include <arv.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/mman.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <new>
#include <set>
#include <thread>

#include "hal/scan/scan_stream.h"

// Problem: a camera is a description file, registers and UDP packets, none of which can be trusted, and a frame that
// lacks packets or belongs to another exposure would be measured like a good one. Idea: read everything that gives the
// bytes a meaning from the node map once, compare every frame with it, and take each exposure on a stream of its own.
// Invariants:
//   - a frame counts only with status SUCCESS and exactly the bytes that the node map announces. Aravis 0.8.26 reports
//     SUCCESS also for a frame that ends early (its trailer has a lower number), and sums up block sizes, so that
//     overlapping blocks can hide a gap. Therefore the memory is filled with kUnwritten before each exposure;
//   - a frame counts only if it was exposed after its trigger: by the camera's clock if it has one. Otherwise an
//   exposure
//     that was given up is waited for, and its frame is discarded;
//   - Aravis writes only into FrameMemory, whose size it is given.
namespace slabd::gateway::genicam {
namespace {

/// Time after which a frame that receives no more packets is given up. Aravis' default of 0.1 s is shorter than a pause
/// of this program on a busy computer; lost packets can be sent again as long as the camera keeps them.
constexpr unsigned kFrameRetention_us = 2'000'000;
/// Time before a missing packet is requested: packets may overtake each other in a switch, or in a network card with
/// several queues.
constexpr unsigned kReorder_us = 2'000;
/// Time before it is requested again.
constexpr unsigned kResend_us = 20'000;
/// Most packets that are requested again, as share of the frame. At a loss of 20 %, which is far beyond any usable
/// network, a quarter of them is needed; Aravis' default 0.25 gives such a frame up.
constexpr double kResendShare = 1.0;
/// Interval in which a waiting exposure looks at the stop flag and at the control lock.
constexpr std::uint64_t kPop_us = 50'000;
/// Largest parts of a multi-part frame (SFNC names nine components).
constexpr unsigned kPartsMax = 16;
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

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}
std::int64_t utime_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

/// Owner of a GError.
class Fault {
 public:
  ~Fault() { g_clear_error(&error_); }
  Fault() = default;
  Fault(const Fault&) = delete;
  Fault& operator=(const Fault&) = delete;
  GError** out() {
    g_clear_error(&error_);
    return &error_;
  }
  explicit operator bool() const { return error_ != nullptr; }
  [[nodiscard]] const char* text() const { return error_ == nullptr ? "unknown error" : error_->message; }

 private:
  GError* error_ = nullptr;
};

template <typename Object>
struct Unref {
  void operator()(Object* object) const { g_object_unref(object); }
};
template <typename Object>
using Owned = std::unique_ptr<Object, Unref<Object>>;

std::string plain(const char* text) {
  std::string out;
  for (const char* c = text == nullptr ? "" : text; *c != '\0'; ++c)
    out += static_cast<unsigned char>(*c) > ' ' && static_cast<unsigned char>(*c) < 0x7F ? *c : '-';
  return out.empty() ? "-" : out;
}

/// Features of the node map. Each function reports the feature's name in its error.
class Nodes {
 public:
  explicit Nodes(ArvDevice* device) : device_(device) {}

  [[nodiscard]] bool has(const char* feature) const {
    Fault fault;
    return arv_device_is_feature_available(device_, feature, fault.out()) && !fault;
  }
  [[nodiscard]] Result<std::string> text(const char* feature) const {
    Fault fault;
    const char* found = arv_device_get_string_feature_value(device_, feature, fault.out());
    if (fault || found == nullptr) return unread(feature, fault);
    return std::string(found);
  }
  [[nodiscard]] Result<std::int64_t> integer(const char* feature) const {
    Fault fault;
    const gint64 found = arv_device_get_integer_feature_value(device_, feature, fault.out());
    if (fault) return unread(feature, fault);
    return std::int64_t{found};
  }
  /// Also of a feature that the camera declares as an integer.
  [[nodiscard]] Result<double> real(const char* feature) const {
    Fault fault;
    const double found = arv_device_get_float_feature_value(device_, feature, fault.out());
    if (!fault) return found;
    const Result<std::int64_t> whole = integer(feature);
    if (!whole) return unread(feature, fault);
    return static_cast<double>(whole.value());
  }
  [[nodiscard]] Result<bool> boolean(const char* feature) const {
    Fault fault;
    const bool found = arv_device_get_boolean_feature_value(device_, feature, fault.out()) != FALSE;
    if (fault) return unread(feature, fault);
    return found;
  }
  [[nodiscard]] Status set(const char* feature, const char* entry) const {
    Fault fault;
    arv_device_set_string_feature_value(device_, feature, entry, fault.out());
    if (fault)
      return error(Code::config, "feature %s: cannot be set to %s: %s; allowed are %s", feature, entry, fault.text(),
                   entries(feature).c_str());
    return success();
  }
  [[nodiscard]] Status set(const char* feature, bool value) const {
    Fault fault;
    arv_device_set_boolean_feature_value(device_, feature, value ? TRUE : FALSE, fault.out());
    if (fault)
      return error(Code::config, "feature %s: cannot be set to %s: %s", feature, value ? "true" : "false",
                   fault.text());
    return success();
  }
  [[nodiscard]] Status execute(const char* feature) const {
    Fault fault;
    arv_device_execute_command(device_, feature, fault.out());
    if (fault) return error(Code::scanner_offline, "feature %s: %s", feature, fault.text());
    return success();
  }
  /// Entries of an enumeration, "A, B, C".
  [[nodiscard]] std::string entries(const char* feature) const {
    std::string all;
    for (const std::string& entry : entry_list(feature)) all += (all.empty() ? "" : ", ") + entry;
    return all.empty() ? "none" : all;
  }
  [[nodiscard]] std::vector<std::string> entry_list(const char* feature) const {
    Fault fault;
    guint count = 0;
    const char** found =
        arv_device_dup_available_enumeration_feature_values_as_strings(device_, feature, &count, fault.out());
    std::vector<std::string> all;
    for (guint i = 0; found != nullptr && i < count; ++i) all.emplace_back(found[i]);
    g_free(static_cast<void*>(found));
    return all;
  }
  /// Sets `feature` to the entry if it has another one; a camera without the feature is as it must be.
  [[nodiscard]] Status require(const char* feature, const char* entry) const {
    if (!has(feature)) return success();
    const Result<std::string> found = text(feature);
    if (found && found.value() == entry) return success();
    const std::vector<std::string> all = entry_list(feature);
    if (std::find(all.begin(), all.end(), entry) == all.end())
      return error(Code::config, "feature %s: found %s, needed is %s, the camera has %s", feature,
                   found ? found.value().c_str() : "nothing", entry, entries(feature).c_str());
    return set(feature, entry);
  }

 private:
  static Error unread(const char* feature, const Fault& fault) {
    return error(Code::config, "feature %s: cannot be read: %s", feature, fault.text());
  }
  ArvDevice* device_;
};

const char* words(ArvBufferStatus status) {
  switch (status) {
    case ARV_BUFFER_STATUS_SUCCESS: return "complete";
    case ARV_BUFFER_STATUS_CLEARED: return "its payload type is none of image, chunk data and multi-part";
    case ARV_BUFFER_STATUS_TIMEOUT: return "packets are missing after the last one arrived";
    case ARV_BUFFER_STATUS_MISSING_PACKETS: return "packets are missing, and the camera cannot send them again";
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID: return "a packet has a number outside the frame";
    case ARV_BUFFER_STATUS_SIZE_MISMATCH: return "the frame is larger than the feature PayloadSize";
    case ARV_BUFFER_STATUS_FILLING: return "the frame is still being received";
    case ARV_BUFFER_STATUS_ABORTED: return "the frame was aborted";
    case ARV_BUFFER_STATUS_UNKNOWN: break;
  }
  return "unknown status";
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

/// Bytes of the first part of a frame with chunks: GigE Vision 2.0, 25.1: [data][id, 4][size, 4] from the end on, the
/// image being the first one. frame_incomplete if the chain does not meet the frame's begin.
Result<std::size_t> first_chunk_bytes(std::span<const std::byte> frame) {
  constexpr std::size_t kTagBytes = 8;
  std::size_t end = frame.size();
  for (;;) {
    if (end < kTagBytes)
      return error(Code::frame_incomplete, "chunk data: a tag of %zu bytes is missing at byte %zu", kTagBytes, end);
    std::array<std::uint8_t, 4> big{};
    std::memcpy(big.data(), &frame[end - 4], big.size());
    const std::size_t bytes =
        (std::size_t{big[0]} << 24U) | (std::size_t{big[1]} << 16U) | (std::size_t{big[2]} << 8U) | std::size_t{big[3]};
    if (bytes > end - kTagBytes)
      return error(Code::frame_incomplete, "chunk data: the chunk before byte %zu declares %zu bytes, left are %zu",
                   end, bytes, end - kTagBytes);
    end -= kTagBytes + bytes;
    if (end == 0) return bytes;
  }
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

}  // namespace

struct Camera::Aravis {
  Owned<ArvCamera> camera;
  ArvDevice* device = nullptr;  ///< belongs to `camera`
  std::atomic<bool> control_lost = false;
  std::uint64_t tick_frequency = 0;
  gulong signal = 0;

  [[nodiscard]] Nodes nodes() const { return Nodes(device); }
  /// The camera's clock in ns, as Aravis converts time stamps of frames; nullopt if it has none.
  [[nodiscard]] std::optional<std::uint64_t> clock_ns() const {
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
  ~Aravis() {
    if (signal != 0) g_signal_handler_disconnect(device, signal);
  }
};

static void on_control_lost(ArvDevice* /*device*/, void* flag) {
  *static_cast<std::atomic<bool>*>(flag) = true;
}

FrameMemory::FrameMemory() {
  void* mapped = ::mmap(nullptr, kFrames * kFrameBytesMax, PROT_READ | PROT_WRITE,
                        MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (mapped == MAP_FAILED) throw std::bad_alloc();
  begin_ = static_cast<std::byte*>(mapped);
}
FrameMemory::~FrameMemory() {
  ::munmap(begin_, kFrames * kFrameBytesMax);
}

Camera::Camera(const config::GenicamSettings& settings, const FrameMemory& memory)
    : settings_(settings), memory_(memory), aravis_(std::make_unique<Aravis>()) {}
Camera::~Camera() = default;

bool Camera::lost() const {
  return aravis_->control_lost;
}

static std::string address_text(GSocketAddress* address) {
  if (!G_IS_INET_SOCKET_ADDRESS(address)) return "?";
  char* text = g_inet_address_to_string(g_inet_socket_address_get_address(G_INET_SOCKET_ADDRESS(address)));
  std::string copy(text);
  g_free(text);
  return copy;
}

Result<std::unique_ptr<Camera>> Camera::open(const config::GenicamSettings& settings, const FrameMemory& memory) {
  // USB cameras and Aravis' built-in one would otherwise be searched first.
  arv_disable_interface("USB3Vision");
  arv_disable_interface("Fake");
  std::unique_ptr<Camera> camera(new Camera(settings, memory));
  Aravis& a = *camera->aravis_;
  Fault fault;
  a.camera.reset(arv_camera_new(settings.camera.c_str(), fault.out()));
  if (a.camera == nullptr)
    return error(Code::scanner_offline,
                 "no camera answers as \"%s\": %s; is it switched on, is this computer in its network? arv-tool-0.8 "
                 "lists cameras",
                 settings.camera.c_str(), fault.text());
  if (arv_camera_is_gv_device(a.camera.get()) == FALSE)
    return error(Code::config, "%s is not a GigE Vision camera", settings.camera.c_str());
  a.device = arv_camera_get_device(a.camera.get());
  auto* device = ARV_GV_DEVICE(a.device);
  camera->link_.camera_address = address_text(arv_gv_device_get_device_address(device));
  camera->link_.interface_address = address_text(arv_gv_device_get_interface_address(device));
  if (arv_gv_device_is_controller(device) == FALSE)
    return error(Code::scanner_offline,
                 "the camera %s is controlled by another program, or by an earlier run of this one until the camera's "
                 "heartbeat timeout ends",
                 camera->link_.camera_address.c_str());
  a.signal = g_signal_connect(a.device, "control-lost", G_CALLBACK(on_control_lost), &a.control_lost);
  if (Status status = camera->configure(); !status) {
    // A register that does not answer is not a wrong setting.
    if (camera->lost())
      return error(Code::scanner_offline, "control of the camera was lost: %s", status.error().text.c_str());
    return status.error();
  }
  return camera;
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

/// Adds "name=value" lines of all writable features below a category, in the node map's order.
static void add_settings(const Nodes& nodes, ArvDevice* device, ArvGcNode* category, std::set<std::string>& seen,
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

namespace {

/// The bytes of the component in a frame that Aravis reports as complete, checked against the node map.
Result<std::span<const std::byte>> component_of(ArvBuffer* buffer, const PointLayout& layout, std::size_t payload_bytes,
                                                std::int64_t component_id) {
  std::size_t received = 0;
  const auto* data = static_cast<const std::byte*>(arv_buffer_get_data(buffer, &received));
  const std::span<const std::byte> frame(data, received);
  const ArvBufferPayloadType type = arv_buffer_get_payload_type(buffer);
  const bool chunks = arv_buffer_has_chunks(buffer) != FALSE;
  const unsigned parts = arv_buffer_get_n_parts(buffer);
  const auto has_geometry = [&](unsigned part) -> Status {
    const Result<PointFormat> format = point_format_of(arv_buffer_get_part_pixel_format(buffer, part));
    if (!format) return error(Code::frame_incomplete, "%s", format.error().text.c_str());
    gint x_padding = 0;
    gint y_padding = 0;
    arv_buffer_get_part_padding(buffer, part, &x_padding, &y_padding);
    const auto width = static_cast<std::uint32_t>(arv_buffer_get_part_width(buffer, part));
    const auto height = static_cast<std::uint32_t>(arv_buffer_get_part_height(buffer, part));
    if (format.value() != layout.format || width != layout.width || height != layout.height || x_padding != 0 ||
        y_padding != 0)
      return error(Code::frame_incomplete,
                   "the frame has %u x %u points of %s with padding %d and %d, the node map has %u x %u of %s; allowed "
                   "padding is 0",
                   width, height, info(format.value()).name, x_padding, y_padding, layout.width, layout.height,
                   info(layout.format).name);
    return success();
  };
  if (type == ARV_BUFFER_PAYLOAD_TYPE_MULTIPART) {
    if (chunks)
      return error(Code::frame_incomplete,
                   "a multi-part frame with chunk data; allowed is feature ChunkModeActive = false with multi-part");
    if (parts == 0 || parts > kPartsMax)
      return error(Code::frame_incomplete, "the frame has %u parts, allowed are 1 to %u", parts, kPartsMax);
    std::size_t sum = 0;
    std::optional<unsigned> found;
    std::string ids;
    for (unsigned i = 0; i < parts; ++i) {
      std::size_t bytes = 0;
      static_cast<void>(arv_buffer_get_part_data(buffer, i, &bytes));
      if (bytes > received - sum)
        return error(Code::frame_incomplete, "the parts have more bytes than the %zu that arrived", received);
      sum += bytes;
      const unsigned id = arv_buffer_get_part_component_id(buffer, i);
      ids += (ids.empty() ? "" : ", ") + std::to_string(id);
      if (id != component_id) continue;
      if (found) return error(Code::frame_incomplete, "the frame has component %u twice", id);
      found = i;
    }
    if (sum != received) return error(Code::frame_incomplete, "%zu bytes arrived, the parts have %zu", received, sum);
    if (!found)
      return error(Code::frame_incomplete, "the frame has components %s, needed is %lld (ComponentIDValue)",
                   ids.c_str(), static_cast<long long>(component_id));
    if (Status status = has_geometry(*found); !status) return status.error();
    std::size_t bytes = 0;
    const auto* part = static_cast<const std::byte*>(arv_buffer_get_part_data(buffer, *found, &bytes));
    if (bytes != layout.bytes())
      return error(Code::frame_incomplete, "the component has %zu bytes, needed are %zu", bytes, layout.bytes());
    return std::span<const std::byte>(part, bytes);
  }
  if (type != ARV_BUFFER_PAYLOAD_TYPE_IMAGE && type != ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA)
    return error(
        Code::frame_incomplete,
        "the frame has GigE Vision payload type %d; allowed are 1 (image), 5 (extended chunk data), 10 (multi-part)",
        static_cast<int>(type));
  if (parts != 1) return error(Code::frame_incomplete, "the image has %u parts, allowed is 1", parts);
  if (Status status = has_geometry(0); !status) return status.error();
  if (!chunks) {
    if (received != layout.bytes())
      return error(Code::frame_incomplete, "%zu bytes arrived, the frame has %zu", received, layout.bytes());
    return frame;
  }
  if (received > payload_bytes || received < layout.bytes())
    return error(Code::frame_incomplete, "%zu bytes arrived, allowed are %zu to %zu (feature PayloadSize)", received,
                 layout.bytes(), payload_bytes);
  const Result<std::size_t> image = first_chunk_bytes(frame);
  if (!image) return image.error();
  if (image.value() != layout.bytes())
    return error(Code::frame_incomplete, "chunk data: the image has %zu bytes, needed are %zu", image.value(),
                 layout.bytes());
  return frame.first(image.value());
}

}  // namespace

Status Camera::settle_debt(std::int64_t until_ns, const std::function<bool()>& stop) {
  if (link_.has_clock) return success();
  while (now_ns() < owed_until_ns_) {
    if (stop()) return error(Code::interrupted, "the exposure was cancelled");
    if (now_ns() >= until_ns)
      return error(Code::trigger_timeout, "the camera may still send the frame of the exposure before, for %.1f s",
                   static_cast<double>(owed_until_ns_ - now_ns()) / 1e9);
    std::this_thread::sleep_for(std::chrono::microseconds(kPop_us));
  }
  return success();
}

/// Sets the receive buffer of the stream's socket. Aravis sets it only after the first packet of a frame has been
/// processed, and a camera at full rate fills the default buffer in less than 2 ms. It does not give its socket away,
/// so this process' sockets are searched for the stream's port.
static void widen_socket(std::uint16_t port) {
  constexpr int kDescriptorsMax = 256;  // the program uses a dozen
  for (int fd = 3; fd < kDescriptorsMax; ++fd) {
    sockaddr_in own{};
    socklen_t bytes = sizeof own;
    int type = 0;
    socklen_t type_bytes = sizeof type;
    if (::getsockname(fd, static_cast<sockaddr*>(static_cast<void*>(&own)), &bytes) != 0 || own.sin_family != AF_INET ||
        ntohs(own.sin_port) != port || ::getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &type_bytes) != 0 ||
        type != SOCK_DGRAM)
      continue;
    const int size = config::kGenicamSocketBytes;
    ::setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &size, sizeof size);
  }
}

Result<Shot> Camera::take(std::int64_t wait_ns, std::span<float> xyz, const std::function<bool()>& stop) {
  const std::int64_t latest_ns = now_ns() + wait_ns;
  if (Status status = settle_debt(latest_ns, stop); !status) return status.error();
  const auto exposure_ns = static_cast<std::int64_t>(settings_.timeout_s * 1e9);
  const std::int64_t begin_ns = now_ns();
  const std::int64_t until_ns = std::min(latest_ns, begin_ns + exposure_ns);
  const double limit_s = static_cast<double>(until_ns - begin_ns) / 1e9;
  const Nodes nodes = aravis_->nodes();
  ArvCamera* camera = aravis_->camera.get();
  Fault fault;
  // A stream of its own for each exposure: another UDP port, no frame numbers and no buffers of the one before.
  const Owned<ArvStream> stream(arv_camera_create_stream(camera, nullptr, nullptr, fault.out()));
  if (stream == nullptr) return error(Code::scanner_offline, "no stream from the camera: %s", fault.text());
  g_object_set(stream.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
               config::kGenicamSocketBytes, "packet-request-ratio", kResendShare, "initial-packet-timeout", kReorder_us,
               "packet-timeout", kResend_us, "frame-retention", kFrameRetention_us, nullptr);
  widen_socket(arv_gv_stream_get_port(ARV_GV_STREAM(stream.get())));
  for (std::size_t i = 0; i < kFrames; ++i) {
    const std::span<std::byte> memory = memory_.frame(i).first(link_.payload_bytes);
    std::memset(memory.data(), std::to_integer<int>(kUnwritten), memory.size());
    arv_stream_push_buffer(stream.get(), arv_buffer_new(memory.size(), memory.data()));
  }
  // Stopped in any case, so that the camera sends nothing between two requests.
  struct Stopper {
    const Nodes& nodes;
    ~Stopper() { static_cast<void>(nodes.execute("AcquisitionStop")); }
  };
  const bool software = settings_.trigger == config::GenicamSettings::Trigger::software;
  const std::optional<std::uint64_t> asked_ns = link_.has_clock ? aravis_->clock_ns() : std::nullopt;
  if (link_.has_clock && !asked_ns) return error(Code::scanner_offline, "the camera's clock does not answer");
  const Stopper stopper{nodes};
  if (Status status = nodes.execute("AcquisitionStart"); !status) return status.error();
  if (software)
    if (Status status = nodes.execute("TriggerSoftware"); !status) return status.error();
  owed_until_ns_ = now_ns() + 2 * exposure_ns;
  Shot shot;
  while (now_ns() < until_ns) {
    if (stop()) return error(Code::interrupted, "the exposure was cancelled");
    if (lost()) return error(Code::scanner_offline, "control of the camera was lost");
    const Owned<ArvBuffer> buffer(arv_stream_timeout_pop_buffer(stream.get(), kPop_us));
    if (buffer == nullptr) continue;
    if (asked_ns && arv_buffer_get_status(buffer.get()) == ARV_BUFFER_STATUS_SUCCESS &&
        arv_buffer_get_timestamp(buffer.get()) < *asked_ns) {
      ++shot.frames_discarded;  // exposed before the request
      continue;
    }
    owed_until_ns_ = 0;
    const std::uint64_t missing = arv_stream_get_info_uint64_by_name(stream.get(), "n_missing_packets");
    shot.packets_requested = arv_stream_get_info_uint64_by_name(stream.get(), "n_resend_requests");
    if (const ArvBufferStatus status = arv_buffer_get_status(buffer.get()); status != ARV_BUFFER_STATUS_SUCCESS)
      return error(
          Code::frame_incomplete,
          "the frame is not complete: %s; %llu packets are missing, %llu were requested again (slabctl doctor: "
          "packet size, socket buffers)",
          words(status), static_cast<unsigned long long>(missing),
          static_cast<unsigned long long>(shot.packets_requested));
    const Result<std::span<const std::byte>> raw =
        component_of(buffer.get(), layout_, link_.payload_bytes, component_id_);
    if (!raw) return raw.error();
    if (const std::size_t gap = first_gap(layout_, raw.value()); gap != raw.value().size())
      return error(Code::frame_incomplete, "the bytes from %zu on never arrived, although the camera ended the frame",
                   gap);
    shot.width = layout_.width;
    shot.height = layout_.height;
    shot.utime_us = utime_us();
    shot.finite = convert(layout_, raw.value(), xyz.first(3 * layout_.points()));
    // Optional: few cameras have the node, and a scan without a temperature is a scan.
    if (nodes.has("DeviceTemperature"))
      if (const Result<double> temperature = nodes.real("DeviceTemperature")) shot.temperature_c = temperature.value();
    return shot;
  }
  if (const std::uint64_t packets = arv_stream_get_info_uint64_by_name(stream.get(), "n_received_packets");
      packets != 0)
    return error(
        Code::frame_incomplete,
        "the frame is not complete after %.1f s: %llu packets arrived, %llu were requested again", limit_s,
        static_cast<unsigned long long>(packets),
        static_cast<unsigned long long>(arv_stream_get_info_uint64_by_name(stream.get(), "n_resend_requests")));
  return error(Code::trigger_timeout, "no frame within %.1f s after the trigger", limit_s);
}

std::vector<std::string> cameras_found() {
  arv_disable_interface("USB3Vision");
  arv_disable_interface("Fake");
  arv_update_device_list();
  std::vector<std::string> found;
  for (unsigned i = 0; i < arv_get_n_devices(); ++i)
    found.push_back(fmt::format("{}  {}", arv_get_device_id(i), arv_get_device_address(i)));
  return found;
}

}  // namespace slabd::gateway::genicam
