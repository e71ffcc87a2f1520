// SPDX-License-Identifier: Apache-2.0
//
// Aravis' own fake camera with 3-D points: genicam_fake_camera DESCRIPTION.xml WIDTH HEIGHT FILE... Each frame is the
// next file of raw little-endian float32, x y z, without a header; a line on stdin makes it the last one again. Listens
// on 127.0.0.1 until it is ended.
#include <arv.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

namespace {

struct Frames {
  std::vector<std::string> files;
  std::atomic<std::size_t> next = 0;
};

void fill(ArvBuffer* buffer, void* data, guint32 /*exposure_us*/, guint32 /*gain*/, ArvPixelFormat /*format*/) {
  Frames& frames = *static_cast<Frames*>(data);
  const std::string& path = frames.files[frames.next++ % frames.files.size()];
  // The fake camera itself sizes the buffer: width * height * bytes of the format.
  const auto bytes =
      static_cast<std::streamsize>(arv_buffer_get_image_width(buffer)) * arv_buffer_get_image_height(buffer) * 12;
  std::size_t ignored = 0;
  auto* memory = static_cast<char*>(const_cast<void*>(arv_buffer_get_data(buffer, &ignored)));
  std::ifstream(path, std::ios::binary).read(memory, bytes);
  std::printf("trigger %s\n", path.c_str());
  std::fflush(stdout);
}

}  // namespace

/// GLib's sendmsg(): at the pace of a network. The fake camera sends a frame as fast as the computer can, and never
/// sends a packet again.
extern "C" ssize_t sendmsg(int fd, const msghdr* message, int flags) {
  constexpr double kBitsPerSecond = 400e6;
  static std::atomic<std::int64_t> due_ns{0};
  const long sent = ::syscall(SYS_sendmsg, fd, message, flags);
  if (sent < 1'000) return sent;  // control
  const std::int64_t now_ns = std::chrono::steady_clock::now().time_since_epoch().count();
  due_ns =
      std::max(due_ns.load(), now_ns) + static_cast<std::int64_t>(8e9 * static_cast<double>(sent) / kBitsPerSecond);
  if (due_ns - now_ns > 1'000'000) std::this_thread::sleep_for(std::chrono::nanoseconds(due_ns - now_ns));
  return sent;
}

int main(int argc, char** argv) {
  if (argc < 5) return 2;
  Frames frames;
  frames.files.assign(argv + 4, argv + argc);
  ArvGvFakeCamera* device = arv_gv_fake_camera_new_full("127.0.0.1", "FAKE-3D", argv[1]);
  if (arv_gv_fake_camera_is_running(device) == FALSE) return 4;
  ArvFakeCamera* camera = arv_gv_fake_camera_get_fake_camera(device);
  arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_WIDTH, static_cast<guint32>(std::atoi(argv[2])));
  arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_HEIGHT, static_cast<guint32>(std::atoi(argv[3])));
  arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_PIXEL_FORMAT, ARV_PIXEL_FORMAT_COORD3D_ABC_32F);
  arv_fake_camera_set_fill_pattern(camera, fill, &frames);
  std::printf("ready\n");
  std::fflush(stdout);
  for (int c = std::getchar(); c != EOF; c = std::getchar()) {
    if (c != '\n') continue;
    --frames.next;
    std::printf("set back\n");
    std::fflush(stdout);
  }
  g_object_unref(device);
  return 0;
}
