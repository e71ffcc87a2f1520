// SPDX-License-Identifier: Apache-2.0
#include "tests/storage/fast_store.h"

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <stdexcept>

namespace slabd::storage {

namespace fs = std::filesystem;

namespace {

std::string fast_folder() {
  return fs::is_directory("/dev/shm") && access("/dev/shm", W_OK) == 0 ? "/dev/shm"
                                                                       : fs::temp_directory_path().string();
}

}  // namespace

FastStoreTest::FastStoreTest() {
  std::string name = fast_folder() + "/slabd-survival-XXXXXX";
  if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no folder for images");
  images_ = name;
  root_ = images_ + "/life";
  fs::create_directories(root_);
  settings_.db_path = root_ + "/db/slabd.db";
  settings_.spool_dir = root_ + "/spool";
  settings_.spool_free_bytes_min = 0;
}

FastStoreTest::~FastStoreTest() {
  close();
  fs::remove_all(images_);
}

}  // namespace slabd::storage
