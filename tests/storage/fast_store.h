// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tests/storage/store_fixture.h"

namespace slabd::storage {

/// A store in memory if possible, because ordered failures do not require ten thousand syncs to a disk.
class FastStoreTest : public StoreTest {
 protected:
  FastStoreTest();
  ~FastStoreTest() override;

  std::string images_;  ///< the test's own folder
  std::string root_;    ///< folder below it with database and spool, subject to power cuts
};

}  // namespace slabd::storage
