// SPDX-License-Identifier: Apache-2.0
//
// Aravis' own fake camera with 3-D points: genicam_fake_camera DESCRIPTION.xml WIDTH HEIGHT FILE... Each frame is the
// next file of raw little-endian float32, x y z, without a header. Listens on 127.0.0.1 until it is ended.
#include <arv.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

namespace {

struct Frames {
  std::vector<std::string> files;
  std::size_t next = 0;
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

int main(int argc, char** argv) {
  if (argc < 5) return 2;
  Frames frames{{argv + 4, argv + argc}};
  sigset_t ends;
  sigemptyset(&ends);
  sigaddset(&ends, SIGTERM);
  sigaddset(&ends, SIGINT);
  sigprocmask(SIG_BLOCK, &ends, nullptr);
  ArvGvFakeCamera* device = arv_gv_fake_camera_new_full("127.0.0.1", "FAKE-3D", argv[1]);
  if (arv_gv_fake_camera_is_running(device) == FALSE) return 4;
  ArvFakeCamera* camera = arv_gv_fake_camera_get_fake_camera(device);
  arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_WIDTH, static_cast<guint32>(std::atoi(argv[2])));
  arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_HEIGHT, static_cast<guint32>(std::atoi(argv[3])));
  arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_PIXEL_FORMAT, ARV_PIXEL_FORMAT_COORD3D_ABC_32F);
  arv_fake_camera_set_fill_pattern(camera, fill, &frames);
  std::printf("ready\n");
  std::fflush(stdout);
  int signal = 0;
  sigwait(&ends, &signal);
  g_object_unref(device);
  return 0;
}
