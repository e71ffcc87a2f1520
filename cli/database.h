// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "storage/storage.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// Selection of the database of a reading command.
namespace slabd::cli {

struct DatabaseOptions {
  std::string db;
  std::string config;
  void add_to(args::Command& command);
};

/// Opens the database read-only; stops on an error. `text`: programs if the output is JSON or raw.
[[nodiscard]] std::unique_ptr<storage::Reader> open_database(const DatabaseOptions& options,
                                                             storage::TextFor text = storage::TextFor::people);

}  // namespace slabd::cli
