// SPDX-License-Identifier: Apache-2.0
#include "gateway/genicam/camera.h"

#include <arpa/inet.h>
#include <arv.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/mman.h>
#include <sys/socket.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <new>
#include <thread>

#include "gateway/genicam/camera_parts.h"
#include "gateway/genicam/frame.h"

// Problem: a camera is a description file, registers and UDP packets, none of which can be trusted, and a frame that
// lacks packets or belongs to another exposure would be measured like a good one. Idea: read everything that gives the
// bytes a meaning from the node map once, compare every frame with it, and take each exposure on a stream of its own.
// Invariants:
//   - a frame counts only with status SUCCESS and exactly the bytes that the node map announces. Aravis 0.8.26 reports
//     SUCCESS also for a frame that ends early (its trailer has a lower number), and sums up block sizes, so that
//     overlapping blocks can hide a gap. Therefore the memory is filled with kUnwritten before each exposure;
//   - a frame counts only if it was exposed after its trigger: by the camera's clock if it has one. Otherwise an
//     exposure that was given up is waited for, and its frame is discarded;
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

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}
std::int64_t utime_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

Camera::Aravis::~Aravis() {
  if (signal != 0) g_signal_handler_disconnect(device, signal);
}

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
    if (asked_ns && is_complete(buffer.get()) && arv_buffer_get_timestamp(buffer.get()) < *asked_ns) {
      ++shot.frames_discarded;  // exposed before the request
      continue;
    }
    owed_until_ns_ = 0;
    const std::uint64_t missing = arv_stream_get_info_uint64_by_name(stream.get(), "n_missing_packets");
    shot.packets_requested = arv_stream_get_info_uint64_by_name(stream.get(), "n_resend_requests");
    if (!is_complete(buffer.get()))
      return error(
          Code::frame_incomplete,
          "the frame is not complete: %s; %llu packets are missing, %llu were requested again (slabctl doctor: "
          "packet size, socket buffers)",
          state_words(buffer.get()), static_cast<unsigned long long>(missing),
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
