// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tests/storage/store_fixture.h"

namespace slabd::storage {

/// A store in memory, where there is some: what fails there by order need not be synced to a disk ten thousand times.
class FastStoreTest : public StoreTest {
 protected:
  FastStoreTest();
  ~FastStoreTest() override;

  std::string images_;  ///< a folder of the test's own
  std::string root_;    ///< in it: database and spool; what the power is cut of
};

}  // namespace slabd::storage
